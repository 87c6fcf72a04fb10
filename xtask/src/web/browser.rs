//! Runs the twins of `tests/web` in headless Chromium.

use std::io::{BufRead, BufReader, Read, Write};
use std::net::{TcpListener, TcpStream};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::mpsc::{Sender, channel};
use std::time::Duration;

use anyhow::{Context, Result, bail};

use super::TARGET;
use crate::shell::{is_installed, run_cargo};

/// Package with the twins.
const PACKAGE: &str = "photofit-web-tests";
/// Where the module and the page are put.
const FOLDER: &str = "target/web";
/// Where `wasm-bindgen` is looked for, before the path.
const TOOLS: &str = "target/tools";
/// How long the page may take: a browser compiles all kernels for a processor.
const LIMIT: Duration = Duration::from_secs(300);
/// WebGPU without a graphics card, by the software driver that Chromium has with it.
const FLAGS: [&str; 6] = [
    "--headless=new",
    "--no-sandbox",
    "--no-first-run",
    "--enable-unsafe-webgpu",
    "--enable-features=Vulkan",
    "--use-webgpu-adapter=swiftshader",
];
const PAGE: &str = r#"<!doctype html>
<script type="module">
const told = text => fetch("/report", { method: "POST", body: text });
try {
    const { default: init, run } = await import("./photofit_web_tests.js");
    await init();
    await told(await run());
} catch (error) {
    await told(`FAILED: ${error}\n${error.stack}\n`);
}
</script>
"#;

/// Builds the module, shows it to Chromium and prints what it reports; says so where a program is missing.
pub(super) fn run() -> Result<()> {
    let Some(chromium) = ["chromium", "google-chrome"].into_iter().find(|name| is_installed(name, &[]))
    else {
        println!("SKIPPED: twins in a browser: no chromium; `apt-get install chromium`");
        return Ok(());
    };
    let version = locked_version("wasm-bindgen")?;
    let Some(bindgen) = bindgen(&version) else {
        println!(
            "SKIPPED: twins in a browser: no wasm-bindgen {version}; \
             `cargo install wasm-bindgen-cli --version {version} --root {TOOLS}`"
        );
        return Ok(());
    };
    run_cargo(&["build", "--target", TARGET, "-p", PACKAGE, "--lib"])?;
    let module = format!("target/{TARGET}/debug/{}.wasm", PACKAGE.replace('-', "_"));
    let glue = ["--target", "web", "--no-typescript", "--out-dir", FOLDER, &module];
    let status = Command::new(&bindgen).args(glue).status();
    if !status.with_context(|| format!("{}: cannot start", bindgen.display()))?.success() {
        bail!("{}: cannot read {module}", bindgen.display());
    }
    std::fs::write(Path::new(FOLDER).join("index.html"), PAGE)?;
    let report = shown(chromium)?;
    print!("{report}");
    match report.lines().last() {
        Some(last) if last.starts_with("passed") => Ok(()),
        _ => bail!("twins in {chromium} do not agree"),
    }
}

/// The version of a package in the lock file.
fn locked_version(package: &str) -> Result<String> {
    let lock = std::fs::read_to_string("Cargo.lock").context("Cargo.lock")?;
    let head = format!("name = \"{package}\"\nversion = \"");
    let rest = lock.split_once(&head).with_context(|| format!("Cargo.lock: no {package}"))?.1;
    Ok(rest.split('"').next().unwrap_or_default().to_owned())
}

/// The program that makes the glue of a module: it reads modules of its own version only.
fn bindgen(version: &str) -> Option<PathBuf> {
    [Path::new(TOOLS).join("bin/wasm-bindgen"), "wasm-bindgen".into()].into_iter().find(|program| {
        let output = Command::new(program).arg("--version").output();
        output.is_ok_and(|o| String::from_utf8_lossy(&o.stdout).trim() == format!("wasm-bindgen {version}"))
    })
}

/// What the page reports, opened in a browser.
fn shown(browser: &str) -> Result<String> {
    let listener = TcpListener::bind("127.0.0.1:0").context("a port for the page")?;
    let address = listener.local_addr()?;
    let (sender, receiver) = channel();
    std::thread::spawn(move || {
        for stream in listener.incoming().flatten() {
            let sender = sender.clone();
            // A browser opens connections ahead of what it asks for.
            std::thread::spawn(move || drop(answer(stream, &sender)));
        }
    });
    let profile = std::env::current_dir()?.join(FOLDER).join("profile");
    let mut command = Command::new(browser);
    command.args(FLAGS).arg(format!("--user-data-dir={}", profile.display()));
    command.arg(format!("http://{address}/index.html")).stdout(Stdio::null()).stderr(Stdio::null());
    let mut child = Running(command.spawn().with_context(|| format!("{browser}: cannot start"))?);
    let report = receiver.recv_timeout(LIMIT);
    let ended = child.0.try_wait()?.map_or("it still runs".into(), |status| status.to_string());
    report.with_context(|| format!("{browser}: no report within {} s; {ended}", LIMIT.as_secs()))
}

/// A program that ends with the task.
struct Running(Child);

impl Drop for Running {
    fn drop(&mut self) {
        drop(self.0.kill().and_then(|()| self.0.wait()));
    }
}

/// Answers one request: a file of the page, or its report.
fn answer(mut stream: TcpStream, report: &Sender<String>) -> Result<()> {
    let mut reader = BufReader::new(stream.try_clone()?);
    let mut lines = Vec::new();
    loop {
        let mut line = String::new();
        if reader.read_line(&mut line)? == 0 || line.trim().is_empty() {
            break;
        }
        lines.push(line.trim().to_lowercase());
    }
    let Some(first) = lines.first() else { return Ok(()) };
    let body = if first.starts_with("post /report ") {
        let length = lines.iter().find_map(|l| l.strip_prefix("content-length:"));
        let mut text = vec![0; length.context("a length")?.trim().parse()?];
        reader.read_exact(&mut text)?;
        report.send(String::from_utf8_lossy(&text).into_owned())?;
        Some(("text/plain", Vec::new()))
    } else {
        let asked = first.split(' ').nth(1).unwrap_or_default();
        let files = [
            ("/index.html", "text/html"),
            ("/photofit_web_tests.js", "text/javascript"),
            ("/photofit_web_tests_bg.wasm", "application/wasm"),
        ];
        let known = files.into_iter().find(|(name, _)| *name == asked);
        known.and_then(|(name, kind)| Some((kind, std::fs::read(format!("{FOLDER}{name}")).ok()?)))
    };
    let (status, (kind, body)) = match body {
        Some(body) => ("200 OK", body),
        None => ("404 Not Found", ("text/plain", Vec::new())),
    };
    let length = body.len();
    write!(
        stream,
        "HTTP/1.1 {status}\r\nContent-Type: {kind}\r\nContent-Length: {length}\r\nConnection: close\r\n\r\n"
    )?;
    stream.write_all(&body)?;
    Ok(())
}
