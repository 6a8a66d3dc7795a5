//! Pairs of a scene and a protocol that a benchmark leaves out, because the scene has too few frames for the protocol.

use std::{fmt, path::PathBuf};

use omnilife_bench::{BenchError, protocols, split};
use omnilife_schemas::{records::Scene, store};

use super::benchmark;
use crate::exit::BadRequest;

/// Protocols of a benchmark without `--protocols`.
const DEFAULT_PROTOCOLS: [&str; 2] = ["per-scene", "sparse-interpolation"];

/// A scene and a protocol that has no split of its frames.
pub(crate) struct LeftOut {
    pub(crate) scene: String,
    /// Id of the protocol.
    pub(crate) protocol: String,
    /// Reason in one line.
    pub(crate) reason: String,
}

impl LeftOut {
    /// Returns whether it is this scene under this protocol.
    pub(crate) fn is_of(&self, scene: &str, protocol: &str) -> bool {
        self.scene == scene && self.protocol == protocol
    }
}

impl fmt::Display for LeftOut {
    fn fmt(&self, line: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            line,
            "scene {}: protocol {} is left out: {}",
            self.scene, self.protocol, self.reason
        )
    }
}

/// Returns the protocols of a benchmark, and the pairs that it leaves out. Without `named` protocols these are the
/// default ones, and a scene that is too short for one of them is left out of it.
///
/// # Errors
/// When a protocol is unknown, a scene is unusable or too short for a named protocol, or no pair remains.
pub(crate) fn protocols_for(
    scenes: &[PathBuf],
    named: &[String],
) -> anyhow::Result<(Vec<String>, Vec<LeftOut>)> {
    let ids = match named {
        [] => DEFAULT_PROTOCOLS.map(str::to_owned).to_vec(),
        named => named.to_vec(),
    };
    let scenes = benchmark::scenes(scenes)?;
    let left_out = find(&scenes, &ids)?;
    let some_remain = left_out.len() < scenes.len() * ids.len();
    match left_out.first() {
        Some(first) if !named.is_empty() || !some_remain => Err(BadRequest(format!(
            "scene {}: protocol {} cannot be followed: {}",
            first.scene, first.protocol, first.reason
        ))
        .into()),
        _ => Ok((ids, left_out)),
    }
}

/// Returns the pairs of which the protocol's rule leaves no views to give or to score. Scenes with other faults are no
/// such pair: their units fail.
fn find(scenes: &[(String, PathBuf)], ids: &[String]) -> anyhow::Result<Vec<LeftOut>> {
    let mut found = Vec::new();
    for (id, file) in scenes {
        let scene: Scene = store::read_record(file)?;
        for protocol in ids {
            let made = split(&scene, &protocols::protocol(protocol)?);
            if let Err(BenchError::Protocol { reason, .. }) = made {
                found.push(LeftOut {
                    scene: id.clone(),
                    protocol: protocol.clone(),
                    reason,
                });
            }
        }
    }
    Ok(found)
}
