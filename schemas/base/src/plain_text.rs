//! Text of others, such as names, ids and reasons, made harmless for output.

use std::borrow::Cow;

use serde::Serializer;

/// Returns text for a terminal. Control characters, and those that change the direction of writing, are spelled out;
/// line breaks stay.
pub fn for_terminal(text: &str) -> Cow<'_, str> {
    let is_harmful = |character: char| {
        (character.is_control() && character != '\n') || turns_direction(character)
    };
    if !text.contains(is_harmful) {
        return Cow::Borrowed(text);
    }
    let mut shown = String::with_capacity(text.len() + 16);
    for character in text.chars() {
        if is_harmful(character) {
            shown.extend(character.escape_default());
        } else {
            shown.push(character);
        }
    }
    Cow::Owned(shown)
}

/// Returns whether a character changes the order in which the text behind it is shown.
fn turns_direction(character: char) -> bool {
    matches!(character, '\u{202a}'..='\u{202e}' | '\u{2066}'..='\u{2069}')
}

/// Returns a number with its noun, which takes an s in the plural: `1 frame`, `0 frames`.
pub fn counted(count: usize, noun: &str) -> String {
    let plural = if count == 1 { "" } else { "s" };
    format!("{count} {noun}{plural}")
}

/// Returns text for a line or a table cell of Markdown: no part of it is a link, an image, markup or the end of the
/// cell.
pub fn for_markdown(text: &str) -> String {
    let mut escaped = String::with_capacity(text.len());
    for character in text.chars() {
        match character {
            '|' | '*' | '_' | '`' | '<' | '[' | ']' | '!' | '&' | '~' | '\\' => {
                escaped.push('\\');
                escaped.push(character);
            }
            character if character.is_control() => escaped.push(' '),
            character => escaped.push(character),
        }
    }
    escaped
}

/// Returns text for a page of HTML, between tags or in a quoted attribute.
pub fn for_html(text: &str) -> String {
    let mut escaped = String::with_capacity(text.len());
    for character in text.chars() {
        match character {
            '&' => escaped.push_str("&amp;"),
            '<' => escaped.push_str("&lt;"),
            '>' => escaped.push_str("&gt;"),
            '"' => escaped.push_str("&quot;"),
            '\'' => escaped.push_str("&#39;"),
            character => escaped.push(character),
        }
    }
    escaped
}

/// Returns text for a cell of a table that spreadsheets open. They take a text that starts with one of `= + - @` as a
/// formula, and an apostrophe in front as the mark of a text.
pub fn for_spreadsheet(text: &str) -> Cow<'_, str> {
    if text.starts_with(['=', '+', '-', '@', '\t', '\r']) {
        Cow::Owned(format!("'{text}"))
    } else {
        Cow::Borrowed(text)
    }
}

/// Serializes with [`for_spreadsheet`], for `#[serde(serialize_with = "...")]` on a field of a row.
///
/// # Errors
/// Those of the serializer.
pub fn serialize_for_spreadsheet<S: Serializer>(
    text: &str,
    serializer: S,
) -> Result<S::Ok, S::Error> {
    serializer.serialize_str(&for_spreadsheet(text))
}

/// Returns text for shared records: a path that begins at a root, in the home folder, or with `./` or `../` keeps its
/// last name alone. It must be at the start or behind white space, a quote, a bracket or one of `,;=`.
pub fn without_folders(text: &str) -> String {
    let ends = |character: char| character.is_whitespace() || "'\"`()[]<>,;=".contains(character);
    let mut shown = String::with_capacity(text.len());
    for word in text.split_inclusive(ends) {
        let rest = word.trim_start_matches(['/', '\\']);
        let is_rooted = rest.len() < word.len() || rest.get(1..3) == Some(":\\");
        let begins_above = ["~/", "./", "../"]
            .iter()
            .any(|begin| word.starts_with(begin));
        let name = word.trim_end_matches(ends).trim_end_matches('/');
        let folders = name.rfind(['/', '\\']).map_or(0, |at| at + 1);
        let begin = if is_rooted || begins_above {
            folders
        } else {
            0
        };
        shown.push_str(&word[begin..]);
    }
    shown
}

/// Lists the first three names, and the number of the others.
pub fn first_of(names: &[String]) -> String {
    const SHOWN: usize = 3;
    let shown = &names[..names.len().min(SHOWN)];
    match names.len() - shown.len() {
        0 => shown.join(", "),
        others => format!("{} and {others} more", shown.join(", ")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn control_characters_are_spelled_out() {
        assert_eq!(for_terminal("plain ü\nline"), "plain ü\nline");
        assert_eq!(for_terminal("\u{1b}[31mred\r"), "\\u{1b}[31mred\\r");
        assert_eq!(for_terminal("a\u{9b}b\u{202e}c"), "a\\u{9b}b\\u{202e}c");
    }

    #[test]
    fn a_image_in_a_name_is_no_image() {
        assert_eq!(
            for_markdown("![](https://e.org/p.png) a_b & <b>|"),
            "\\!\\[\\](https://e.org/p.png) a\\_b \\& \\<b>\\|"
        );
        assert_eq!(for_markdown("two\nlines"), "two lines");
    }

    #[test]
    fn tags_and_quotes_in_a_name_are_text() {
        assert_eq!(
            for_html("<b> & \"c\" 'd'"),
            "&lt;b&gt; &amp; &quot;c&quot; &#39;d&#39;"
        );
    }

    #[test]
    fn of_paths_of_a_machine_the_name_stays() {
        for (text, shown) in [
            ("/home/ann/x.mp4: is empty", "x.mp4: is empty"),
            (
                "cannot open '/data/x/' (../lists/a.csv)",
                "cannot open 'x/' (a.csv)",
            ),
            (
                "FILE=~/w/net.bin, C:\\films\\x.mp4;/a/b",
                "FILE=net.bin, x.mp4;b",
            ),
            (
                "30000/1001 fps and a/x.mp4 / b",
                "30000/1001 fps and a/x.mp4 / b",
            ),
            ("nothing\nhere", "nothing\nhere"),
            ("", ""),
        ] {
            assert_eq!(without_folders(text), shown);
        }
    }

    #[test]
    fn formulas_are_text() {
        for formula in ["=cmd|' /C calc'!A0", "+1", "-1", "@SUM(A1)", "\t=1"] {
            assert_eq!(for_spreadsheet(formula), format!("'{formula}"));
        }
        assert_eq!(for_spreadsheet("odgs=1"), "odgs=1");
    }
}
