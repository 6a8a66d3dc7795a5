//! The protocols: rules of scoring.
//!
//! To add one: a file with a [`ProtocolEntry`] and a line in [`PROTOCOLS`]. A protocol's hash covers all of its rules
//! and is pinned by a test: every change of a rule needs a new version.

mod alternate_frames;
mod input_view;
mod metric_list;
mod per_scene;
mod published;
mod sparse_interpolation;
mod sparse_panoramas;

use omnilife_schemas::{names, records::Protocol};

use crate::error::BenchError;

/// A named protocol.
#[derive(Debug, Clone, Copy)]
pub struct ProtocolEntry {
    /// Id, unique in [`PROTOCOLS`].
    pub id: &'static str,
    /// Its purpose and source.
    pub description: &'static str,
    /// Makes its rules.
    pub protocol: fn() -> Protocol,
}

/// Every known protocol.
pub static PROTOCOLS: &[ProtocolEntry] = &[
    per_scene::ENTRY,
    sparse_interpolation::ENTRY,
    sparse_panoramas::ENTRY,
    input_view::ENTRY,
    alternate_frames::ENTRY,
    published::ENTRY,
];

/// Returns the protocol of this id.
///
/// # Errors
/// [`BenchError::Unknown`], which lists the known ids.
pub fn protocol(id: &str) -> Result<Protocol, BenchError> {
    let entry = names::find("protocol", id, PROTOCOLS, |entry| entry.id)?;
    Ok((entry.protocol)())
}

/// Returns `<id>/<version>`, as printed beside scores.
pub fn title(protocol: &Protocol) -> String {
    format!("{}/{}", protocol.id, protocol.version)
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use super::*;
    use crate::metrics;

    /// Raise a protocol's version when its hash changes, then pin the new hash here.
    const HASHES: &[(&str, u32, &str)] = &[
        (
            "per-scene",
            2,
            "8f99c41122e8bd2d7b9830af0889541c9ed7618d68579961b65cf4c3731f4244",
        ),
        (
            "sparse-interpolation",
            1,
            "ceb122dc67f1da9b60810f9c434742e4742746f5ad13926485cb843fe5effd54",
        ),
        (
            "sparse-panoramas",
            1,
            "7970c23481a4a3f4a5cc2367991b6b9ecbe97635daeb49be50992572f4e22fff",
        ),
        (
            "input-view",
            3,
            "6966f407cbaca0f676a073ea6ff1663bb2bed7441e172aaf8d3855e00aa414b5",
        ),
        (
            "alternate-frames",
            1,
            "43f184b66736af9f99ea7b00038f97bdbc844c71e65d60c4e3e2b1ad4439d41b",
        ),
        (
            "published",
            1,
            "d0a8954233d96fd13f14c367db6061bd4cd36e960c4ad4c9e1a2c52fb26e6afb",
        ),
    ];

    #[test]
    fn ids_are_unique_and_described() {
        let ids: BTreeSet<_> = PROTOCOLS.iter().map(|entry| entry.id).collect();
        assert_eq!(ids.len(), PROTOCOLS.len());
        for entry in PROTOCOLS {
            assert_eq!((entry.protocol)().id, entry.id);
            assert!(
                entry.description.len() > 40,
                "{} needs a description",
                entry.id
            );
        }
    }

    #[test]
    fn metrics_of_every_protocol_are_known() {
        for entry in PROTOCOLS {
            let protocol = (entry.protocol)();
            assert!(metrics::of_protocol(&protocol).is_ok_and(|metrics| !metrics.is_empty()));
        }
    }

    #[test]
    fn a_changed_rule_needs_a_new_version() {
        let now: Vec<_> = PROTOCOLS
            .iter()
            .map(|entry| (entry.protocol)())
            .map(|protocol| (protocol.id.clone(), protocol.version, protocol.hash()))
            .collect();
        let pinned: Vec<_> = HASHES
            .iter()
            .map(|&(id, version, hash)| (id.to_owned(), version, hash.to_owned()))
            .collect();
        assert_eq!(now, pinned);
    }

    #[test]
    fn an_unknown_id_names_the_known_ones() {
        let message = protocol("per-sence").err().map(|error| error.to_string());
        assert_eq!(
            message.as_deref(),
            Some(
                "there is no protocol \"per-sence\"; known: per-scene, sparse-interpolation, \
                 sparse-panoramas, input-view, alternate-frames, published; did you mean \"per-scene\"?"
            )
        );
    }
}
