//! Numbers that are not finite in a `transforms.json`: JSON has none, but several writers print `NaN` and `Infinity`.

use serde_json::Value;

/// What such writers print.
const WORDS: [&str; 4] = ["-Infinity", "Infinity", "-NaN", "NaN"];

/// Where the first number that is not finite stands, and the rule; `None` for a text without, or with other faults too.
pub(super) fn place(bytes: &[u8]) -> Option<String> {
    let text = std::str::from_utf8(bytes).ok()?;
    let quoted = quoted(text)?;
    let file: Value = serde_json::from_str(&quoted).ok()?;
    let (place, word) = find(&file)?;
    let frame = place.strip_prefix("frames[").and_then(|rest| rest.split_once("]."));
    let place = match frame {
        Some((index, key)) => {
            let name = index.parse::<usize>().ok().and_then(|i| file["frames"][i]["file_path"].as_str());
            format!("frame {index} ({}): {key}", name.unwrap_or_default())
        }
        None => place,
    };
    Some(format!("{place} is {word}; it must be finite"))
}

/// The text with such words as strings that begin with a control character; `None` where there are none.
fn quoted(text: &str) -> Option<String> {
    let (mut out, mut rest, mut found) = (String::with_capacity(text.len()), text, false);
    while let Some(first) = rest.chars().next() {
        let length = if first == '"' { string_end(rest) } else { first.len_utf8() };
        match WORDS.iter().find(|w| rest.starts_with(**w)) {
            Some(word) => {
                out += &format!("\"\\u0001{word}\"");
                (rest, found) = (&rest[word.len()..], true);
            }
            None => {
                out += &rest[..length];
                rest = &rest[length..];
            }
        }
    }
    found.then_some(out)
}

/// Bytes of the string that a text begins with, its quotes included.
fn string_end(text: &str) -> usize {
    let mut escaped = false;
    for (i, c) in text.char_indices().skip(1) {
        match c {
            _ if escaped => escaped = false,
            '\\' => escaped = true,
            '"' => return i + 1,
            _ => {}
        }
    }
    text.len()
}

/// Path and text of the first marked word; the depth of the value is that which the parser admits.
fn find(value: &Value) -> Option<(String, &str)> {
    match value {
        Value::String(text) => text.strip_prefix('\u{1}').map(|word| (String::new(), word)),
        Value::Array(list) => list.iter().enumerate().find_map(|(i, v)| {
            let (place, word) = find(v)?;
            let dot = if place.is_empty() || place.starts_with('[') { "" } else { "." };
            Some((format!("[{i}]{dot}{place}"), word))
        }),
        Value::Object(map) => map.iter().find_map(|(key, v)| {
            let (place, word) = find(v)?;
            let dot = if place.is_empty() || place.starts_with('[') { "" } else { "." };
            Some((format!("{key}{dot}{place}"), word))
        }),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::place;

    #[test]
    fn the_frame_the_key_and_the_rule_are_named() {
        let two = |value: &str| {
            format!(
                r#"{{"fl_x": 5, "frames": [{{"file_path": "NaN\" a.png", "transform_matrix": [[1]]}},
                {{"file_path": "b.png", "transform_matrix": [[1, 0], [0, {value}]]}}]}}"#
            )
        };
        for value in ["NaN", "Infinity", "-Infinity"] {
            let rule = format!("frame 1 (b.png): transform_matrix[1][1] is {value}; it must be finite");
            assert_eq!(place(two(value).as_bytes()), Some(rule));
        }
        assert_eq!(place(two("1").as_bytes()), None, "words in strings are no numbers");
        assert_eq!(place(br#"{"cx": NaN, "frames": []}"#), Some("cx is NaN; it must be finite".into()));
        for broken in ["", "NaN NaN", "{\"a", "[NaN", "\u{e9}NaN"] {
            assert_eq!(place(broken.as_bytes()), None, "{broken}");
        }
    }
}
