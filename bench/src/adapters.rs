//! Adapters: a `method.toml` for each published method of the paper's tables.
//!
//! An adapter states how a scene is converted to the input of the method's own code, how that code is called, and where
//! it leaves its views. It also states axes, resolution and pixel convention. It is put into a checkout of that code.
//! To add one: a file in `bench/adapters/` and a line in [`ADAPTERS`].
//!
//! The templates are written from the authors' repositories. None of these programs is part of this project's tests,
//! which need no GPU and no weights: tests check that views in the layout of an adapter reach the right frames.

use std::path::Path;

use omnilife_schemas::{names, ownership::OwnFiles, store};

use crate::error::BenchError;

/// A template for running a published method.
#[derive(Debug, Clone, Copy)]
pub struct Adapter {
    /// Name on the command line.
    pub id: &'static str,
    /// Authors of the method, and its protocol.
    pub about: &'static str,
    /// The `method.toml`, conventions in its head.
    pub manifest: &'static str,
    /// Further files, by name.
    pub files: &'static [(&'static str, &'static str)],
}

const GROUPS: &[(&str, &str)] = &[("groups.py", include_str!("../adapters/groups.py"))];

/// All of them.
pub const ADAPTERS: &[Adapter] = &[
    Adapter {
        id: "odgs",
        about: "ODGS by its authors' code, per-scene",
        manifest: include_str!("../adapters/odgs.toml"),
        files: &[],
    },
    Adapter {
        id: "deformable-gs",
        about: "Deformable 3D Gaussians with a panoramic projection, per-scene",
        manifest: include_str!("../adapters/deformable-gs.toml"),
        files: &[],
    },
    Adapter {
        id: "pvg",
        about: "Periodic Vibration Gaussian with a panoramic projection, per-scene",
        manifest: include_str!("../adapters/pvg.toml"),
        files: &[],
    },
    Adapter {
        id: "pansplat",
        about: "PanSplat, sparse-interpolation",
        manifest: include_str!("../adapters/pansplat.toml"),
        files: GROUPS,
    },
    Adapter {
        id: "splatter-360",
        about: "Splatter-360, its cube faces put together, sparse-interpolation",
        manifest: include_str!("../adapters/splatter-360.toml"),
        files: GROUPS,
    },
    Adapter {
        id: "omnisplat",
        about: "OmniSplat, sparse-interpolation",
        manifest: include_str!("../adapters/omnisplat.toml"),
        files: GROUPS,
    },
    Adapter {
        id: "panosplatt3r",
        about: "PanoSplatt3R, its scale aligned, sparse-interpolation",
        manifest: include_str!("../adapters/panosplatt3r.toml"),
        files: GROUPS,
    },
    Adapter {
        id: "nag",
        about: "Neural Atlas Graphs by their authors' code, input-view",
        manifest: include_str!("../adapters/nag.toml"),
        files: &[],
    },
    Adapter {
        id: "omnire",
        about: "OmniRe by its authors' code (drivestudio), input-view",
        manifest: include_str!("../adapters/omnire.toml"),
        files: &[],
    },
    Adapter {
        id: "street-gaussians",
        about: "Street Gaussians as drivestudio has it, input-view",
        manifest: include_str!("../adapters/street-gaussians.toml"),
        files: &[],
    },
    Adapter {
        id: "emernerf",
        about: "EmerNeRF by its authors' code, input-view",
        manifest: include_str!("../adapters/emernerf.toml"),
        files: &[],
    },
    Adapter {
        id: "layered-neural-atlases",
        about: "Layered Neural Atlases by their authors' code, out of a lossy video, input-view",
        manifest: include_str!("../adapters/layered-neural-atlases.toml"),
        files: &[],
    },
    Adapter {
        id: "omnimatte-rf",
        about: "OmnimatteRF by its authors' code, input-view",
        manifest: include_str!("../adapters/omnimatte-rf.toml"),
        files: &[],
    },
];

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
    use crate::external::manifest::Manifest;

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
            for convention in ["Data:", "Resolution:"] {
                assert!(head.contains(convention), "{}: {convention}", adapter.id);
            }
            // Writing the same again keeps it; another one is not overwritten.
            write_adapter(adapter.id, &folder)?;
        }
        let message = write_adapter("pvg", &folder.path().join("odgs"))
            .err()
            .map(|error| error.to_string());
        assert!(message.is_some_and(|message| message.contains("is in the way")));
        Ok(())
    }
}
