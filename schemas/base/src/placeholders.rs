//! Placeholders in the texts of configuration files: `{name}`, and `{name:06}` for a number that is padded with zeros
//! to 6 digits.
#![cfg_attr(
    not(test),
    deny(clippy::indexing_slicing, clippy::arithmetic_side_effects)
)]

/// Refuses unknown placeholders; `known` are the names, each with true for a number.
///
/// # Errors
/// When one is unknown, a brace is not closed, or padding is given for a text.
pub fn check(text: &str, known: &[(&str, bool)]) -> Result<(), String> {
    for (name, digits) in names(text)? {
        let Some((_, is_number)) = known.iter().find(|(other, _)| *other == name) else {
            let all: Vec<String> = known
                .iter()
                .map(|(name, _)| format!("{{{name}}}"))
                .collect();
            return Err(format!(
                "{text:?}: {{{name}}} is not known; there are {}",
                all.join(", ")
            ));
        };
        if digits > 0 && !is_number {
            return Err(format!(
                "{text:?}: only numbers can be padded, and {{{name}}} is text"
            ));
        }
    }
    Ok(())
}

/// Returns the placeholders in a text with the digits to which they are padded (0 without padding).
///
/// # Errors
/// When a brace is not closed, or padding has another form.
pub fn names(text: &str) -> Result<Vec<(String, usize)>, String> {
    let mut found = Vec::new();
    let mut rest = text;
    while let Some((_, after)) = rest.split_once('{') {
        let Some((inside, after)) = after.split_once('}') else {
            return Err(format!("{text:?}: a brace is not closed"));
        };
        found.push(
            parse(inside).ok_or_else(|| format!("{text:?}: padding is written {{frame:06}}"))?,
        );
        rest = after;
    }
    Ok(found)
}

/// Returns name and digits of `frame:06`.
fn parse(inside: &str) -> Option<(String, usize)> {
    let Some((name, padding)) = inside.split_once(':') else {
        return Some((inside.to_owned(), 0));
    };
    let digits: usize = padding.strip_prefix('0')?.parse().ok()?;
    (1..=20)
        .contains(&digits)
        .then(|| (name.to_owned(), digits))
}

/// Replaces every placeholder that `value` knows, in one pass: a value's own braces stay.
pub fn replace(text: &str, value: impl Fn(&str, usize) -> Option<String>) -> String {
    let mut result = String::new();
    let mut rest = text;
    while let Some((before, after)) = rest.split_once('{') {
        let Some((inside, after)) = after.split_once('}') else {
            break;
        };
        result += before;
        match parse(inside).and_then(|(name, digits)| value(&name, digits)) {
            Some(filled) => result += &filled,
            None => result.extend(["{", inside, "}"]),
        }
        rest = after;
    }
    result + rest
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn placeholders_are_filled_in_one_pass_and_mistakes_are_named() {
        let value = |name: &str, digits: usize| match name {
            "frame" => Some(format!("{:0digits$}", 42)),
            "folder" => Some("/a/{frame}".to_owned()),
            _ => None,
        };
        assert_eq!(
            replace("{folder}/{frame:06}.{other}", value),
            "/a/{frame}/000042.{other}"
        );
        let known = [("frame", true), ("folder", false)];
        assert_eq!(check("{folder}/{frame:06}", &known), Ok(()));
        for (text, reason) in [
            ("{fram}", "{fram} is not known; there are {frame}, {folder}"),
            (
                "{folder:03}",
                "only numbers can be padded, and {folder} is text",
            ),
            ("{frame:3x}", "padding is written {frame:06}"),
            ("{frame", "a brace is not closed"),
        ] {
            let message = check(text, &known).err().unwrap_or_default();
            assert!(message.contains(reason), "{text}: {message}");
        }
    }
}
