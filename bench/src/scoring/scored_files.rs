//! The predictions of a result: names, hashes and places.

use std::path::{Component, Path, PathBuf};

use omnilife_schemas::{
    records::{ScoredFile, ScoredPredictions},
    store::{self, StoreError},
};

use crate::job::{ScoringJob, ViewKind};
use crate::{metrics::Need, prediction::PredictionFolder};

/// Lists the scored files, without those of a failed run.
///
/// # Errors
/// When an existing file cannot be hashed.
pub(super) fn of_job(job: &ScoringJob, out: &Path) -> Result<ScoredPredictions, StoreError> {
    let mut files = Vec::new();
    let with_depth = job.needs(Need::Depth);
    for view in job.views() {
        let Some(folder) = job.folder(view.kind) else {
            continue;
        };
        let depth = with_depth.then(|| folder.depth_file(view.frame));
        for path in folder.files(view.frame).into_iter().chain(depth) {
            if folder.is_read() && path.is_file() {
                files.push(ScoredFile {
                    view: view.kind.to_string(),
                    file: folder.relative(&path),
                    sha256: store::sha256_file(&path)?,
                });
            }
        }
    }
    let place = |kind| {
        job.folder(kind)
            .map(|folder: &PredictionFolder| relative(folder.path(), out))
    };
    Ok(ScoredPredictions {
        input_views: place(ViewKind::Input),
        novel_views: place(ViewKind::Novel),
        files,
    })
}

/// Returns a folder relative to another one, with `/` between names; unchanged if the two share no root.
fn relative(folder: &Path, from: &Path) -> String {
    let absolute = |path: &Path| {
        let located = path.canonicalize().or_else(|_| std::path::absolute(path));
        located.unwrap_or_else(|_| path.to_owned())
    };
    let (folder, from) = (absolute(folder), absolute(from));
    let shared = (folder.components().zip(from.components()))
        .take_while(|(a, b)| a == b)
        .count();
    let has_root = matches!(
        folder.components().next(),
        Some(Component::RootDir | Component::Prefix(_))
    );
    if has_root && shared == 0 {
        return folder.display().to_string();
    }
    let up = from.components().skip(shared).map(|_| Component::ParentDir);
    let path: PathBuf = up.chain(folder.components().skip(shared)).collect();
    let names = path
        .components()
        .map(|name| name.as_os_str().to_string_lossy().into_owned());
    names.collect::<Vec<_>>().join("/")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_folder_is_named_as_seen_from_the_result() -> std::io::Result<()> {
        let temp = tempfile::tempdir()?;
        let at = |name: &str| temp.path().join(name);
        for name in ["scores/mine", "views/novel", "scores/mine/inside"] {
            std::fs::create_dir_all(at(name))?;
        }
        for (folder, expected) in [
            ("views/novel", "../../views/novel"),
            ("scores/mine/inside", "inside"),
            ("scores", ".."),
        ] {
            let found = relative(&at(folder), &at("scores/mine"));
            assert_eq!(found, expected);
            let there = at("scores/mine").join(&found).canonicalize()?;
            assert_eq!(there, at(folder).canonicalize()?);
        }
        Ok(())
    }
}
