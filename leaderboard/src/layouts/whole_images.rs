//! Whole images of input views by sequence: Neural Atlas Graphs, Tables 3, 5, 9 and 11, and the paper on UAV video,
//! Table 1.

use omnilife_schemas::records::Direction;

use super::fidelity::{self, FidelityLayout, Measure};
use crate::{
    group::Group,
    published::{NEURAL_ATLAS_GRAPHS, Paper, PublishedLayout, UAV_URBAN},
    table::Table,
};

const LAYOUT: FidelityLayout = FidelityLayout {
    title: "Whole images of input views by sequence",
    measures: &[
        Measure::of_images("psnr", Some(Direction::HigherIsBetter)),
        Measure::of_images("ssim-skimage-uniform", Some(Direction::HigherIsBetter)),
        Measure::of_images("ssim-4dgf", Some(Direction::HigherIsBetter)),
        Measure::of_images("lpips-alex", Some(Direction::LowerIsBetter)),
    ],
    published: &[
        PublishedLayout {
            paper: NEURAL_ATLAS_GRAPHS,
            numbers: &[3, 5, 9, 11],
            protocol: "input-view",
        },
        PublishedLayout {
            paper: UAV_URBAN,
            numbers: &[1],
            protocol: "input-view",
        },
    ],
    note: "SSIM and LPIPS are of the variants that the authors' code has.",
};

pub(super) fn tables(group: &Group<'_>, papers: &[Paper]) -> Vec<Table> {
    fidelity::tables(group, papers, &LAYOUT)
}
