//! One HTML file that plays Gaussians in time, from disk, without a network and without libraries.
//!
//! A graphics card computes the motion in every frame, and a worker sorts by depth. Without a card, workers draw.

use omnilife_schemas::plain_text::for_html;

use super::page::base64;

const TEMPLATE: &str = include_str!("player.html");
const SCRIPT: &str = concat!(
    include_str!("player_file.js"),
    include_str!("player_webgl.js"),
    include_str!("player.js"),
);
const SORTER: &str = include_str!("player_sorter.js");

/// Returns the text of a page with a file inside; an empty file leaves it out.
pub(super) fn html(title: &str, file: &[u8]) -> String {
    let inside = base64(file);
    // Each placeholder is replaced once, and its text is not searched for the next.
    let mut page =
        String::with_capacity(TEMPLATE.len() + SCRIPT.len() + SORTER.len() + inside.len());
    for (index, part) in TEMPLATE.split("@@").enumerate() {
        match part {
            "TITLE" if index % 2 == 1 => page += &for_html(title),
            "FILE" if index % 2 == 1 => page += &inside,
            "SORTER" if index % 2 == 1 => page += SORTER,
            "SCRIPT" if index % 2 == 1 => page += SCRIPT,
            text => page += text,
        }
    }
    page
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_page_has_its_file_and_scripts_once_and_a_name_stays_text() {
        let page = html("</title><img src=x onerror=alert(1)>@@FILE@@", b"GAUSTIME");
        assert!(!page.contains("<img") && page.contains("&lt;img src=x"));
        let inside = base64(b"GAUSTIME");
        for part in [inside.as_str(), SCRIPT, SORTER] {
            assert_eq!(page.matches(part).count(), 1);
        }
        // A script ends at the first of these.
        for script in [SCRIPT, SORTER] {
            assert!(!script.contains("</script"));
        }
        assert!(!page.contains("http:") && !page.contains("https:"));
    }
}
