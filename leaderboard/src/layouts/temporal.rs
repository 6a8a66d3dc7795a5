//! Consistency over time of input views by sequence: Neural Atlas Graphs, Tables 6 and 7.

use omnilife_schemas::records::Direction;

use super::fidelity::{self, FidelityLayout, Measure};
use crate::{
    group::Group,
    published::{NEURAL_ATLAS_GRAPHS, Paper, PublishedLayout},
    table::Table,
};

/// Reason for the empty columns of distances between distributions.
const NO_NETWORK: &str =
    "the weights of its network are not available, and nothing here computes it";

const fn of_distributions(metric: &'static str) -> Measure {
    Measure {
        never: Some(NO_NETWORK),
        ..Measure::of_images(metric, Some(Direction::LowerIsBetter))
    }
}

const LAYOUT: FidelityLayout = FidelityLayout {
    title: "Consistency over time of input views by sequence",
    measures: &[
        Measure::of_images("temporal-lpips", None),
        Measure::of_images("temporal-lpips-truth", None),
        of_distributions("fvd"),
        of_distributions("fid"),
    ],
    published: &[PublishedLayout {
        paper: NEURAL_ATLAS_GRAPHS,
        numbers: &[6, 7],
        protocol: "input-view",
    }],
    note: "T-LPIPS is the better the nearer it is to that of the ground truth.",
};

pub(super) fn tables(group: &Group<'_>, papers: &[Paper]) -> Vec<Table> {
    fidelity::tables(group, papers, &LAYOUT)
}
