//! Vehicles and people in input views by sequence: Neural Atlas Graphs, Tables 4, 8 and 12.

use omnilife_schemas::records::ObjectClass;

use super::fidelity::{self, FidelityLayout, Measure};
use crate::{
    group::Group,
    published::{NEURAL_ATLAS_GRAPHS, Paper, PublishedLayout},
    table::Table,
};

const LAYOUT: FidelityLayout = FidelityLayout {
    title: "Objects in input views by sequence",
    measures: &[
        Measure::of_objects(ObjectClass::Vehicle, "psnr-object"),
        Measure::of_objects(ObjectClass::Vehicle, "ssim-object"),
        Measure::of_objects(ObjectClass::Person, "psnr-object"),
        Measure::of_objects(ObjectClass::Person, "ssim-object"),
        Measure::of_objects(ObjectClass::Other, "psnr-object"),
        Measure::of_objects(ObjectClass::Other, "ssim-object"),
    ],
    published: &[PublishedLayout {
        paper: NEURAL_ATLAS_GRAPHS,
        numbers: &[4, 8, 12],
        protocol: "input-view",
    }],
    note: "Means over the frames that show an object, then over the objects of a class, in the tight boxes of their \
           masks. The paper does not say whether its scores are of the boxes or of the masks in them, with black \
           around; those are in the results as psnr-object-masked and ssim-object-masked.",
};

pub(super) fn tables(group: &Group<'_>, papers: &[Paper]) -> Vec<Table> {
    fidelity::tables(group, papers, &LAYOUT)
}
