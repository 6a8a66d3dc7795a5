//! `omnilife doctor`: requirements that this machine meets, and the features that each missing one would enable.

use std::{fmt, io, path::Path, thread};

use omnilife_bench::lpips::Backbone;
use omnilife_curate::{boundaries::transnetv2, masks::deeplab, poses::sfm};
use omnilife_engine::device::adapters;
use omnilife_reconstruct::jobs::export::page;
use omnilife_tracks::appearance;
use serde::{Serialize, Serializer, ser::SerializeStruct};

pub(crate) struct Check {
    /// Its name in the report; unique, kebab-case.
    pub(crate) id: &'static str,
    /// Features that need it.
    pub(crate) enables: &'static str,
    /// True where the main job, video to table with given poses, needs it.
    pub(crate) needed: bool,
    /// Checks it. Neither prints nor panics.
    pub(crate) probe: fn() -> Finding,
}

/// Result of a check.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case", tag = "state")]
pub(crate) enum Finding {
    /// Present: versions, names, paths, one per line.
    Present {
        /// Lines of the report.
        found: Vec<String>,
    },
    /// Missing.
    Missing {
        /// Requirement that is missing, or the failure.
        reason: String,
        /// Remedy, where the reason does not say it.
        remedy: Option<String>,
    },
}

/// All checks, in the order of the report.
pub(crate) static CHECKS: &[Check] = &[
    Check {
        id: "ffmpeg",
        enables: "reading video",
        needed: true,
        probe: || linked_libraries(is_ffmpeg),
    },
    Check {
        id: "opencv",
        enables: "colour histograms for shot boundaries",
        needed: true,
        probe: || linked_libraries(|name| name.to_lowercase().contains("opencv")),
    },
    Check {
        id: "sfm",
        enables: "camera poses for videos that come without them",
        needed: false,
        probe: structure_from_motion,
    },
    Check {
        id: "adapters",
        enables: "training and rendering on the GPU (--backend gpu)",
        needed: false,
        probe: graphics_adapters,
    },
    Check {
        id: "models",
        enables: "learned shot boundaries (TransNetV2), perceptual scores (LPIPS), masks of people and \
                  vehicles (DeepLab)",
        needed: false,
        probe: network_weights,
    },
    Check {
        id: "viewer",
        enables: "pages that show Gaussians (reconstruct export --page)",
        needed: false,
        probe: viewer_libraries,
    },
    Check {
        id: "threads",
        enables: "all computing",
        needed: true,
        probe: cpu_threads,
    },
    Check {
        id: "disk",
        enables: "knowing beforehand whether results fit into the current folder",
        needed: false,
        probe: free_disk,
    },
];

/// All checks with their findings. Its `Display` is the text for the user.
pub(crate) struct Report {
    entries: Vec<(&'static Check, Finding)>,
}

impl Serialize for Report {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        /// Check as JSON.
        #[derive(Serialize)]
        struct Entry<'a> {
            id: &'a str,
            enables: &'a str,
            needed: bool,
            #[serde(flatten)]
            finding: &'a Finding,
        }
        let entries = self.entries.iter().map(|(check, finding)| Entry {
            id: check.id,
            enables: check.enables,
            needed: check.needed,
            finding,
        });
        let mut report = serializer.serialize_struct("Report", 4)?;
        report.serialize_field("version", env!("CARGO_PKG_VERSION"))?;
        report.serialize_field("commit", &omnilife_schemas::provenance::commit())?;
        report.serialize_field("is_sound", &self.is_sound())?;
        report.serialize_field("checks", &entries.collect::<Vec<_>>())?;
        report.end()
    }
}

pub(crate) fn report() -> Report {
    Report {
        entries: CHECKS
            .iter()
            .map(|check| (check, (check.probe)()))
            .collect(),
    }
}

impl Report {
    /// Returns whether everything that the main job needs is present.
    pub(crate) fn is_sound(&self) -> bool {
        !self
            .entries
            .iter()
            .any(|(check, finding)| check.needed && matches!(finding, Finding::Missing { .. }))
    }
}

impl fmt::Display for Report {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let commit = omnilife_schemas::provenance::commit();
        writeln!(f, "omnilife {}, commit {commit}", env!("CARGO_PKG_VERSION"))?;
        for (check, finding) in &self.entries {
            let (state, lines) = match finding {
                Finding::Present { found } => ("ok", found.clone()),
                Finding::Missing { reason, remedy } => {
                    let state = if check.needed { "BROKEN" } else { "missing" };
                    let enables = format!("would enable: {}", check.enables);
                    let lines = [Some(reason.clone()), Some(enables), remedy.clone()];
                    (state, lines.into_iter().flatten().collect())
                }
            };
            for (index, line) in lines.iter().enumerate() {
                let (state, id) = if index == 0 {
                    (state, check.id)
                } else {
                    ("", "")
                };
                writeln!(f, "{state:<8} {id:<10} {line}")?;
            }
        }
        let projection = if self.is_sound() {
            "The main job works here: omnilife run VIDEO --poses POSES --out FOLDER"
        } else {
            "The main job does not work here: see the lines marked BROKEN"
        };
        writeln!(f, "{projection}")
    }
}

fn is_ffmpeg(library: &str) -> bool {
    library.starts_with("libav") || library.starts_with("libsw")
}

/// Finds the libraries that the binary is linked to and that `wanted` accepts.
fn linked_libraries(wanted: impl Fn(&str) -> bool) -> Finding {
    let lines: Vec<String> = omnilife_curate::libraries()
        .into_iter()
        .filter(|(name, _)| wanted(name))
        .map(|(name, version)| format!("{name} {version}"))
        .collect();
    if lines.is_empty() {
        Finding::Missing {
            reason: "this build reports no version of it".to_owned(),
            remedy: Some("install it with scripts/setup and build again".to_owned()),
        }
    } else {
        Finding::Present {
            found: vec![lines.join(", ")],
        }
    }
}

fn structure_from_motion() -> Finding {
    match sfm::installation() {
        Ok(found) => Finding::Present {
            found: vec![format!(
                "pycolmap {} in {}",
                found.version,
                found.python.display()
            )],
        },
        Err(error) => Finding::Missing {
            reason: error.to_string(),
            remedy: None,
        },
    }
}

/// Finds the networks with installed weights, and the features that each of the others would enable.
fn network_weights() -> Finding {
    let networks = [
        (
            "TransNetV2: learned shot boundaries",
            transnetv2::published_weights(),
        ),
        (
            "LPIPS with AlexNet: perceptual scores",
            Backbone::Alex.published_weights(),
        ),
        (
            "LPIPS with VGG: perceptual scores",
            Backbone::Vgg.published_weights(),
        ),
        (
            "DeepLab: masks of people and vehicles",
            deeplab::published_weights(),
        ),
        (
            "DeepSORT: tracks of vehicles by what they look like",
            appearance::published_weights(),
        ),
    ];
    let (mut found, mut missing) = (Vec::new(), Vec::new());
    for (what, weights) in networks {
        match weights {
            Ok(weights) => found.push(weights.path().display().to_string()),
            Err(error) => missing.push(format!("{what}: {error}")),
        }
    }
    if missing.is_empty() {
        Finding::Present { found }
    } else {
        Finding::Missing {
            reason: missing.join("; "),
            remedy: Some("scripts/setup --models fetches them".to_owned()),
        }
    }
}

fn viewer_libraries() -> Finding {
    match page::libraries() {
        Ok(_) => {
            let folder = page::viewer_folder();
            let found = folder.iter().map(|folder| folder.display().to_string());
            Finding::Present {
                found: found.collect(),
            }
        }
        Err(missing) => Finding::Missing {
            reason: missing.to_string(),
            remedy: Some("scripts/setup --viewer fetches them".to_owned()),
        },
    }
}

fn graphics_adapters() -> Finding {
    let found = silencing_drivers(adapters::adapters);
    if found.is_empty() {
        return Finding::Missing {
            reason: "no Vulkan, Metal or DX12 adapter".to_owned(),
            remedy: Some("install a GPU driver; scripts/setup installs a software one".to_owned()),
        };
    }
    let describe = |adapter: adapters::AdapterSummary| {
        let line = format!("{} ({}, {})", adapter.name, adapter.backend, adapter.kind);
        if adapter.kind.is_software() {
            line + ": software, slower than --backend cpu"
        } else {
            line
        }
    };
    Finding::Present {
        found: found.into_iter().map(describe).collect(),
    }
}

/// Runs `work` with standard error discarded, because drivers write there as they like. Where redirection fails,
/// their output stays.
#[cfg(unix)]
fn silencing_drivers<T>(work: impl FnOnce() -> T) -> T {
    /// Descriptors below this one are those of the standard streams.
    const FIRST_FREE: i32 = 3;
    let silence = || {
        let stderr = rustix::io::fcntl_dupfd_cloexec(io::stderr(), FIRST_FREE)?;
        let nowhere = std::fs::File::options().write(true).open("/dev/null")?;
        rustix::stdio::dup2_stderr(&nowhere)?;
        Ok::<_, io::Error>(stderr)
    };
    let stderr = silence();
    let found = work();
    if let Ok(stderr) = stderr {
        // If it fails, the report itself is still printed: it goes to the standard output.
        let _ = rustix::stdio::dup2_stderr(&stderr);
    }
    found
}

#[cfg(not(unix))]
fn silencing_drivers<T>(work: impl FnOnce() -> T) -> T {
    work()
}

fn cpu_threads() -> Finding {
    match thread::available_parallelism() {
        Ok(count) => Finding::Present {
            found: vec![count.to_string()],
        },
        // Rayon then works with one thread: slow, not broken.
        Err(error) => Finding::Present {
            found: vec![format!("unknown ({error}); one is used")],
        },
    }
}

fn free_disk() -> Finding {
    match free_bytes(Path::new(".")) {
        Ok(bytes) => Finding::Present {
            found: vec![format!("{:.1} GB", bytes as f64 / 1e9)],
        },
        Err(reason) => Finding::Missing {
            reason: format!("cannot be measured: {reason}"),
            remedy: None,
        },
    }
}

/// Returns the bytes that are free for this user in the file system of `folder`, which exists.
///
/// # Errors
/// When the system does not report them.
#[cfg(unix)]
pub(crate) fn free_bytes(folder: &Path) -> io::Result<u64> {
    let system = rustix::fs::statvfs(folder)?;
    Ok(system.f_bavail.saturating_mul(system.f_frsize))
}

#[cfg(not(unix))]
pub(crate) fn free_bytes(_: &Path) -> io::Result<u64> {
    Err(io::ErrorKind::Unsupported.into())
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use super::*;

    #[test]
    fn checks_are_unique_and_documented() {
        let ids: BTreeSet<_> = CHECKS.iter().map(|check| check.id).collect();
        assert_eq!(ids.len(), CHECKS.len());
        for check in CHECKS {
            assert!(!check.enables.is_empty());
            assert!(
                check.id.chars().all(|c| c.is_ascii_lowercase() || c == '-'),
                "{} is not kebab-case",
                check.id
            );
        }
    }

    #[test]
    fn what_tests_run_on_is_sound() {
        let report = report();
        let text = report.to_string();
        assert!(report.is_sound(), "{text}");
        assert!(text.contains("libavcodec"), "{text}");
        for check in CHECKS {
            assert!(text.contains(check.id), "{text}");
        }
    }

    #[test]
    fn a_missing_need_is_broken_and_a_missing_extra_is_not() {
        let missing = || Finding::Missing {
            reason: "gone".to_owned(),
            remedy: Some("fetch it".to_owned()),
        };
        let entry = |needed| {
            let check = CHECKS.iter().find(|check| check.needed == needed);
            check.map(|check| (check, missing())).into_iter().collect()
        };
        let extra = Report {
            entries: entry(false),
        };
        assert!(extra.is_sound());
        assert!(extra.to_string().contains("missing"));
        assert!(extra.to_string().contains("would enable"));
        let need = Report {
            entries: entry(true),
        };
        assert!(!need.is_sound());
        assert!(need.to_string().contains("BROKEN"));
    }

    #[cfg(unix)]
    #[test]
    fn free_space_is_of_folders_that_are_there() {
        assert!(free_bytes(&std::env::temp_dir()).expect("its file system tells") > 0);
        assert!(free_bytes(Path::new("/nonexistent")).is_err());
    }
}
