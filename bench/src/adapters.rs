//! Adapters: a `method.toml` for each published method of the paper's tables, and for those that are strong today.
//!
//! An adapter writes the data set that the method's own loader reads, calls that code, and states where it leaves its
//! views. The head of its file has axes, resolution and everything that is lost on the way. It is put into a checkout of
//! that code. To add one: files in `bench/adapters/`, a row in `rows.rs`, and a stand-in in `tests/data/adapters` that
//! parses arguments and reads the data as the authors' code does.
//!
//! None of these programs is part of this project's tests, which need no GPU and no weights. Tests run every adapter
//! against its stand-in, and [`Adapter::tried`] says of each whether it has been run against the authors' code.

mod rows;

use std::path::Path;

use omnilife_schemas::{names, ownership::OwnFiles, store};

use crate::error::BenchError;

pub use rows::ADAPTERS;

/// A template for running a published method.
#[derive(Debug, Clone, Copy)]
pub struct Adapter {
    /// Name on the command line.
    pub id: &'static str,
    /// Id of the protocol that it is written for.
    pub protocol: &'static str,
    /// Scenes that it takes.
    pub scenes: AdapterScenes,
    /// Authors of the method, and its kind of views.
    pub about: &'static str,
    /// The `method.toml`, conventions in its head.
    pub manifest: &'static str,
    /// Further files, by name.
    pub files: &'static [(&'static str, &'static str)],
    /// Repository, commit and files of the loader that the adapter was written from.
    pub loader: &'static str,
    /// Data set that this loader reads.
    pub reads: &'static str,
    /// Content of a scene that this data set does not hold, and other losses.
    pub lost: &'static str,
    /// Form of the views that the method leaves, and their way back to the scene's frames.
    pub views: &'static str,
    /// Experience with it.
    pub tried: AdapterTrial,
}

/// Scenes that an adapter takes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum AdapterScenes {
    /// Panoramas, and others too unless its head excludes them.
    Panoramas,
    /// Perspective images alone.
    Perspective,
    /// Perspective images with distances and with boxes of what moves.
    Traffic,
    /// The same of a single camera.
    OneCamera,
}

/// Experience with an adapter.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum AdapterTrial {
    /// Never run against the authors' code; tests run it against a stand-in of their loader.
    StandIn,
    /// Run against the authors' code at this commit.
    AuthorsCode(&'static str),
}

impl AdapterTrial {
    /// Returns the answer to "run against the authors' code?".
    pub fn describe(self) -> String {
        match self {
            Self::StandIn => "not yet; dry-run against a stand-in of its loader".to_owned(),
            Self::AuthorsCode(commit) => format!("yes, at {commit}"),
        }
    }
}

/// Returns the list as a table in Markdown.
pub fn adapters_table() -> String {
    let mut text = "| adapter | method | protocol | loader that was read | data that it reads | lost | views | run \
                    against the authors' code |\n|---|---|---|---|---|---|---|---|\n"
        .to_owned();
    for adapter in ADAPTERS {
        text += &format!(
            "| `{}` | {} | {} | {} | {} | {} | {} | {} |\n",
            adapter.id,
            adapter.about,
            adapter.protocol,
            adapter.loader,
            adapter.reads,
            adapter.lost,
            adapter.views,
            adapter.tried.describe()
        );
    }
    text
}

/// Writes an adapter's `method.toml`, and the files beside it, into a folder, which is created if missing.
///
/// # Errors
/// When there is no adapter of this name, the folder has another `method.toml`, or a file cannot be written.
pub fn write_adapter(id: &str, folder: &Path) -> Result<&'static Adapter, BenchError> {
    let adapter = names::find("adapter", id, ADAPTERS, |adapter| adapter.id)?;
    let manifest = folder.join("method.toml");
    let own = OwnFiles::new(folder, []);
    for (name, text) in adapter
        .files
        .iter()
        .chain([&("method.toml", adapter.manifest)])
    {
        own.refuse_changed(name, &store::sha256_bytes(text.as_bytes()))?;
    }
    store::create_folder(folder)?;
    for (name, text) in adapter.files {
        store::write_bytes(&folder.join(name), text.as_bytes())?;
    }
    store::write_bytes(&manifest, adapter.manifest.as_bytes())?;
    Ok(adapter)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{external::manifest::Manifest, protocols::PROTOCOLS};

    #[test]
    fn every_adapter_is_a_valid_manifest_with_its_conventions() -> Result<(), BenchError> {
        let folder = tempfile::tempdir()
            .map_err(|source| store::StoreError::write(Path::new("temporary"), source))?;
        for adapter in ADAPTERS {
            let folder = folder.path().join(adapter.id);
            write_adapter(adapter.id, &folder)?;
            let manifest = Manifest::read(&folder.join("method.toml"))?;
            assert!(manifest.source.is_some() && manifest.notes.is_some());
            let head: String = adapter
                .manifest
                .lines()
                .filter(|line| line.starts_with('#'))
                .collect();
            for convention in ["Data:", "Resolution:", "Loader:", "Lost:"] {
                assert!(head.contains(convention), "{}: {convention}", adapter.id);
            }
            let known = PROTOCOLS
                .iter()
                .any(|protocol| protocol.id == adapter.protocol);
            assert!(known, "{}: {}", adapter.id, adapter.protocol);
            for (name, _) in adapter.files {
                assert!(
                    adapter.manifest.contains(name) || *name == "ply.py",
                    "{}: {name}",
                    adapter.id
                );
            }
            // Writing the same again keeps it; another one is not overwritten.
            write_adapter(adapter.id, &folder)?;
        }
        let message = write_adapter("pfgs360", &folder.path().join("odgs"))
            .err()
            .map(|error| error.to_string());
        assert!(message.is_some_and(|message| message.contains("is in the way")));
        Ok(())
    }

    #[test]
    fn the_guide_has_the_table() -> std::io::Result<()> {
        let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("../docs/guides/external.md");
        let page = std::fs::read_to_string(&file)?;
        let (before, rest) = page
            .split_once("<!-- adapters -->\n")
            .unwrap_or((page.as_str(), ""));
        let (_, after) = rest.split_once("<!-- end -->").unwrap_or(("", rest));
        let table = adapters_table();
        let expected = format!("{before}<!-- adapters -->\n{table}<!-- end -->{after}");
        if std::env::var_os("UPDATE_ADAPTERS_TABLE").is_some() {
            std::fs::write(&file, &expected)?;
        }
        assert!(
            std::fs::read_to_string(&file)? == expected,
            "the table of docs/guides/external.md is not the list: UPDATE_ADAPTERS_TABLE=1 cargo test -p \
             omnilife-bench the_guide_has_the_table"
        );
        Ok(())
    }
}
