//! One HTML file that shows an asset, from disk and without a network: it contains the viewer's libraries and a
//! level.
//!
//! The libraries are Spark and three.js, under the MIT licence. `scripts/setup --viewer` fetches them into the
//! data folder; their SHA-256 is checked before they go into a page.

use std::{fs, path::PathBuf};

use base64::{Engine, engine::general_purpose::STANDARD};
use omnilife_schemas::{
    plain_text::for_html,
    records::{AssetLevel, AssetMoments, AssetPlacement, AssetSplats},
    store,
};

/// Maximum number of Gaussians inside a page: 43 MB of text.
pub const MOST_SPLATS_INSIDE: u64 = 1_000_000;
/// Maximum number of Gaussians of all moments of a dynamic scene together, of which few are drawn at a time.
pub(super) const MOST_SPLATS_OF_MOMENTS: u64 = 2_500_000;

/// A file of the viewer.
struct Library {
    /// Name in the viewer's folder, and in the page's import map.
    file: &'static str,
    name: &'static str,
    sha256: &'static str,
}

const LIBRARIES: [Library; 4] = [
    Library {
        file: "three.module.min.js",
        name: "three",
        sha256: "e2b5ee6bccd38fd6d8a2428546b83c5f2426d84b152ef82be8055556e3b40eb6",
    },
    Library {
        file: "three.core.min.js",
        name: "three-core",
        sha256: "61ba0df005b05991361d040d8ff670e1aadfd0ce7aeebd1fdb0725957a8957de",
    },
    Library {
        file: "Pass.js",
        name: "three/addons/postprocessing/Pass.js",
        sha256: "444b409c235ead986893c472e720da1b779a56985c7d10b279c7944b52bd61c5",
    },
    Library {
        file: "spark.module.min.js",
        name: "spark",
        sha256: "96869fab4f2164d5d267b1df1e1b636c05e6499973cb8dddec23387919b38526",
    },
];

/// Reason for a missing page; one line with the command that fixes it.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("no page: {0}; scripts/setup --viewer fetches the viewer's libraries")]
pub struct NoViewer(String);

/// Returns the folder of the viewer's libraries; `None` without a folder for data.
pub fn viewer_folder() -> Option<PathBuf> {
    Some(store::data_folder()?.join("viewer"))
}

/// Returns the libraries, checked, in the order of `LIBRARIES`.
///
/// # Errors
/// When one is missing or has another checksum.
pub fn libraries() -> Result<Vec<Vec<u8>>, NoViewer> {
    let folder = viewer_folder().ok_or_else(|| {
        NoViewer("neither OMNILIFE_DATA, XDG_DATA_HOME nor HOME is set".to_owned())
    })?;
    let read = |library: &Library| {
        let path = folder.join(library.file);
        let bytes =
            fs::read(&path).map_err(|error| NoViewer(format!("{}: {error}", path.display())))?;
        if store::sha256_bytes(&bytes) != library.sha256 {
            let reason = format!(
                "{}: is another version than the page is made for",
                path.display()
            );
            return Err(NoViewer(reason));
        }
        Ok(bytes)
    };
    LIBRARIES.iter().map(read).collect()
}

pub(super) struct PageContent<'a> {
    /// Title of the scene; it comes from a file.
    pub(super) title: &'a str,
    pub(super) levels: &'a [AssetLevel],
    pub(super) moments: Option<&'a AssetMoments>,
    pub(super) placement: AssetPlacement,
    /// The part of the asset inside the page.
    pub(super) inside: Option<EmbeddedData<'a>>,
    /// The bytes of its files, one after the other.
    pub(super) bytes: &'a [u8],
}

/// Data inside a page.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum EmbeddedData<'a> {
    /// A level.
    Level(&'a AssetLevel),
    /// All moments of a dynamic scene, behind its static Gaussians.
    Moments(&'a AssetMoments),
}

impl<'a> EmbeddedData<'a> {
    /// Returns its files, in their order in the page.
    pub(super) fn files(&self) -> Vec<&'a str> {
        match self {
            Self::Level(level) => vec![&level.file],
            Self::Moments(moments) => {
                let moving = moments.moments.iter().map(|moment| &*moment.moving.file);
                [&*moments.still.file].into_iter().chain(moving).collect()
            }
        }
    }
}

const TEMPLATE: &str = include_str!("page.html");

pub(super) fn html(content: &PageContent<'_>, libraries: &[Vec<u8>]) -> String {
    let data_url = |bytes: &[u8]| format!("data:text/javascript;base64,{}", base64(bytes));
    let imports = LIBRARIES.iter().zip(libraries).map(|(library, bytes)| {
        // A module in a data: URL has no folder for "./".
        let text =
            String::from_utf8_lossy(bytes).replace("\"./three.core.min.js\"", "\"three-core\"");
        (library.name, data_url(text.as_bytes()))
    });
    let imports: serde_json::Map<String, serde_json::Value> = imports
        .map(|(name, url)| (name.to_owned(), url.into()))
        .collect();
    let levels: Vec<serde_json::Value> = content
        .levels
        .iter()
        .map(|level| {
            serde_json::json!({
                "name": level.name, "file": level.file, "splats": level.splats, "bytes": level.bytes,
            })
        })
        .collect();
    let settings = serde_json::json!({
        "title": content.title,
        "levels": levels,
        "moments": content.moments.map(moments_of),
        "inside": match content.inside {
            Some(EmbeddedData::Level(level)) => Some(&level.name),
            _ => None,
        },
        "insideMoments": matches!(content.inside, Some(EmbeddedData::Moments(_))),
        "unitsPerWorldUnit": content.placement.scale,
    });
    let inside = base64(content.bytes);
    let import_map = serde_json::json!({ "imports": imports });
    // Each placeholder is replaced once, and its text is not searched for the next.
    let mut page = String::with_capacity(TEMPLATE.len() + inside.len() + 8_000_000);
    for (index, part) in TEMPLATE.split("@@").enumerate() {
        match part {
            "TITLE" if index % 2 == 1 => page += &for_html(content.title),
            "IMPORTS" if index % 2 == 1 => page += &in_script(&import_map),
            "SETTINGS" if index % 2 == 1 => page += &in_script(&settings),
            "SPLATS" if index % 2 == 1 => page += &inside,
            text => page += text,
        }
    }
    page
}

/// Returns the page's data about moments.
fn moments_of(moments: &AssetMoments) -> serde_json::Value {
    let file =
        |splats: &AssetSplats| serde_json::json!({ "file": splats.file, "bytes": splats.bytes });
    let all: Vec<serde_json::Value> = moments
        .moments
        .iter()
        .map(|moment| {
            serde_json::json!({ "seconds": moment.time_seconds, "moving": file(&moment.moving) })
        })
        .collect();
    serde_json::json!({ "still": file(&moments.still), "moments": all })
}

/// Returns JSON that cannot end the script around it.
fn in_script(value: &serde_json::Value) -> String {
    value.to_string().replace('<', "\\u003c")
}

pub(super) fn base64(bytes: &[u8]) -> String {
    STANDARD.encode(bytes)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_from_files_stay_text() {
        let content = PageContent {
            title: "</script><img src=x onerror=alert(1)>@@SPLATS@@",
            levels: &[],
            moments: None,
            placement: AssetPlacement {
                offset: [0.0; 3],
                scale: 1.0,
                rotation_wxyz: [1.0, 0.0, 0.0, 0.0],
            },
            inside: None,
            bytes: b"BYTES",
        };
        let page = html(&content, &vec![Vec::new(); 4]);
        assert!(!page.contains("<img") && !page.contains("script><"));
        assert!(page.contains("&lt;/script&gt;&lt;img src=x onerror=alert(1)&gt;@@SPLATS@@"));
        assert_eq!(page.matches(&base64(b"BYTES")).count(), 1);
        for placeholder in ["@@TITLE", "@@IMPORTS", "@@SETTINGS"] {
            assert!(!page.contains(placeholder));
        }
    }
}
