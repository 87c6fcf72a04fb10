//! The page around the sections, and pieces of HTML.

use std::fs::File;
use std::io::Read;
use std::path::Path;

/// What stands in the head of every page.
const GENERATOR: &str = "<meta name=generator content=photofit>";
/// Bytes of a page that hold its head, before the title.
const HEAD: u64 = 256;

/// Whether a file is a page of [`page`]; false where there is none.
pub(super) fn is_page(file: &Path) -> bool {
    let mut head = Vec::new();
    let read = File::open(file).and_then(|f| f.take(HEAD).read_to_end(&mut head));
    read.is_ok() && head.windows(GENERATOR.len()).any(|w| w == GENERATOR.as_bytes())
}

/// A page with its style and script inside.
pub(super) fn page(title: &str, body: &str) -> String {
    format!(
        "<!DOCTYPE html>\n<html lang=en>\n<head>\n<meta charset=utf-8>\n\
         {GENERATOR}\n<meta name=viewport content=\"width=device-width\">\n<title>{}</title>\n<style>\n{}</style>\n</head>\n\
         <body>\n<main>\n{body}</main>\n<script>\n{}</script>\n</body>\n</html>\n",
        escape(title),
        include_str!("style.css"),
        include_str!("slider.js"),
    )
}

/// A picture with a caption; `name` says to the script which picture it is.
pub(super) fn figure(uri: &str, name: &str, caption: &str) -> String {
    format!(
        "<figure><img src=\"{uri}\" alt=\"{0}\" data-name=\"{0}\"><figcaption>{caption}</figcaption></figure>\n",
        escape(name)
    )
}

/// Text as HTML.
pub(super) fn escape(text: &str) -> String {
    let mut out = String::with_capacity(text.len());
    for c in text.chars() {
        match c {
            '&' => out.push_str("&amp;"),
            '<' => out.push_str("&lt;"),
            '>' => out.push_str("&gt;"),
            '"' => out.push_str("&quot;"),
            c => out.push(c),
        }
    }
    out
}

/// A count with separated thousands.
pub fn count(n: usize) -> String {
    grouped(n as u64)
}

/// A number with separated thousands.
pub(crate) fn grouped(n: u64) -> String {
    let digits = n.to_string();
    let mut out = String::new();
    for (i, c) in digits.chars().enumerate() {
        if i > 0 && (digits.len() - i).is_multiple_of(3) {
            out.push(',');
        }
        out.push(c);
    }
    out
}

/// A number of things for people, in the singular or in the plural.
pub fn counted(n: usize, what: &str) -> String {
    let many = match what {
        "vertex" => "vertices".to_owned(),
        "medium" => "media".to_owned(),
        what => format!("{what}s"),
    };
    format!("{} {}", count(n), if n == 1 { what } else { &many })
}

/// A number of bytes for people.
pub(super) fn bytes(n: u64) -> String {
    let x = n as f64;
    if n < 1 << 20 { format!("{:.0} KiB", x / 1024.0) } else { format!("{:.1} MiB", x / (1 << 20) as f64) }
}
