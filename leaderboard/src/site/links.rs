//! Links from pages to the records of their results.

use std::path::{Component, Path, PathBuf};

use omnilife_schemas::{
    layout::{CURVE_FILE, RESULT_FILE},
    records::ResultRecord,
};

/// Files in the folder of a run, which lies beside that of its scores.
const RUN_FILES: [(&str, &str); 2] = [
    ("run", "../run/run.json"),
    ("Gaussians", "../run/gaussians.ply"),
];

/// Links from pages to files of results, given only where both lie together: any other site is published elsewhere, and
/// its links would be dead.
pub(super) struct Links {
    /// The searched folder of results, and its absolute path.
    results: Option<[PathBuf; 2]>,
    /// Absolute path of the site.
    site: PathBuf,
}

/// Returns true for an address that a page may link to, `https` or `http`; other schemes could run scripts.
pub fn is_web_address(text: &str) -> bool {
    let host = ["https://", "http://"].map(|scheme| text.strip_prefix(scheme));
    let host = host.into_iter().flatten().next();
    host.is_some_and(|host| !host.is_empty() && !host.contains(char::is_whitespace))
}

impl Links {
    pub(super) fn between(results: &Path, site: &Path) -> Self {
        let absolute = |path: &Path| std::path::absolute(path).map(|path| normal(&path));
        let (Ok(found), Ok(site)) = (absolute(results), absolute(site)) else {
            return Self {
                results: None,
                site: site.to_owned(),
            };
        };
        // Beside each other, or one in the other.
        let together = found
            .parent()
            .is_some_and(|parent| site.starts_with(parent));
        Self {
            results: together.then(|| [results.to_owned(), found]),
            site,
        }
    }

    /// Returns existing files of a run and its scoring in the folder of a result, if they lie beside the site.
    pub(super) fn of_result(
        &self,
        folder: &Path,
        result: &ResultRecord,
    ) -> Vec<(&'static str, String)> {
        if self.results.is_none() {
            return Vec::new();
        }
        let of_scores = [
            ("result", RESULT_FILE),
            ("frames", result.frames_table.as_str()),
            ("curve", CURVE_FILE),
        ];
        (of_scores.into_iter().chain(RUN_FILES))
            .filter_map(|(text, file)| Some((text, self.to(&folder.join(file))?)))
            .collect()
    }

    /// Returns the relative path from a page in a folder of the site to an existing file below the results.
    fn to(&self, file: &Path) -> Option<String> {
        let [searched, results] = self.results.as_ref()?;
        let target = normal(&results.join(file.strip_prefix(searched).ok()?));
        if !target.is_file() {
            return None;
        }
        let page = self.site.join("folder");
        let shared = page
            .components()
            .zip(target.components())
            .take_while(|(a, b)| a == b)
            .count();
        let up = page.components().count() - shared;
        let mut parts = vec!["..".to_owned(); up];
        let down = target.components().skip(shared);
        parts.extend(down.map(|part| encoded(&part.as_os_str().to_string_lossy())));
        Some(parts.join("/"))
    }
}

/// Returns a path without `.` and `..`, links not followed.
fn normal(path: &Path) -> PathBuf {
    let mut normal = PathBuf::new();
    for part in path.components() {
        match part {
            Component::CurDir => {}
            Component::ParentDir => {
                normal.pop();
            }
            other => normal.push(other),
        }
    }
    normal
}

/// Encodes a part of a path for an address (RFC 3986, section 2.3: unreserved characters stay).
fn encoded(part: &str) -> String {
    let mut text = String::with_capacity(part.len());
    for byte in part.bytes() {
        if byte.is_ascii_alphanumeric() || b"-._~".contains(&byte) {
            text.push(char::from(byte));
        } else {
            text.push_str(&format!("%{byte:02X}"));
        }
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pages_link_to_the_web_alone() {
        for address in ["https://example.org", "http://localhost:8000/a?b"] {
            assert!(is_web_address(address), "{address}");
        }
        for other in [
            "javascript:alert(1)",
            "example.org",
            "https://",
            "https://a b",
            "",
        ] {
            assert!(!is_web_address(other), "{other}");
        }
    }

    #[test]
    fn ways_lead_up_to_what_is_shared_and_down_again() -> std::io::Result<()> {
        let folder = tempfile::tempdir()?;
        let results = folder.path().join("results");
        std::fs::create_dir_all(results.join("a b"))?;
        std::fs::write(results.join("a b/result.json"), "")?;
        let file = results.join("a b/result.json");
        let links = Links::between(&results, &folder.path().join("out/site"));
        let way = "../../../results/a%20b/result.json";
        assert_eq!(links.to(&file).as_deref(), Some(way));
        assert_eq!(links.to(&results.join("a b/missing")), None);
        let inside = Links::between(&results, &results.join("board/site"));
        assert_eq!(
            inside.to(&file).as_deref(),
            Some("../../../a%20b/result.json")
        );
        let elsewhere = Links::between(&results, Path::new("/elsewhere/site"));
        assert_eq!(elsewhere.to(&file), None);
        Ok(())
    }
}
