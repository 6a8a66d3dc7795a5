//! Variants of a method in input views, whole images and objects: Neural Atlas Graphs, Table 10.

use omnilife_schemas::records::{Direction, ObjectClass};

use super::{
    fidelity::{self, FidelityLayout, Measure},
    mark_classes,
};
use crate::{
    class::MethodClass,
    group::{Group, MethodRow},
    published::{NEURAL_ATLAS_GRAPHS, Paper, PublishedLayout},
    table::{Mark, Row, Table},
    variants,
};

const LAYOUT: FidelityLayout = FidelityLayout {
    title: "Ablation",
    measures: &[
        Measure::of_images("psnr", Some(Direction::HigherIsBetter)),
        Measure::of_images("ssim-skimage-uniform", Some(Direction::HigherIsBetter)),
        Measure::of_images("lpips-alex", Some(Direction::LowerIsBetter)),
        Measure::of_objects(ObjectClass::Vehicle, "psnr-object"),
        Measure::of_objects(ObjectClass::Vehicle, "ssim-object"),
        Measure::of_objects(ObjectClass::Person, "psnr-object"),
        Measure::of_objects(ObjectClass::Person, "ssim-object"),
    ],
    published: &[PublishedLayout {
        paper: NEURAL_ATLAS_GRAPHS,
        numbers: &[10],
        protocol: "input-view",
    }],
    note: "Objects: means over frames, then over the objects of a class.",
};

/// Returns one table for every method that has variants.
pub(super) fn tables(group: &Group<'_>, papers: &[Paper]) -> Vec<Table> {
    let measures = fidelity::measured(group, &LAYOUT);
    if measures.is_empty() {
        return Vec::new();
    }
    let of_whole = |whole: &MethodRow<'_>| {
        let mut variants: Vec<(String, &MethodRow<'_>)> = (group.methods.iter())
            .filter(|method| method.whole == Some(whole.method))
            .map(|method| (variants::label(whole.method, method.method), method))
            .collect();
        if variants.is_empty() {
            return None;
        }
        let whole = group
            .methods
            .iter()
            .find(|one| one.method == whole.method)?;
        variants.push((format!("{} (full)", whole.method), whole));
        Some(table(group, papers, &measures, whole.method, &variants))
    };
    group.methods.iter().filter_map(of_whole).collect()
}

fn table(
    group: &Group<'_>,
    papers: &[Paper],
    measures: &[Measure],
    whole: &str,
    methods: &[(String, &MethodRow<'_>)],
) -> Table {
    let row = |(name, method): &(String, &MethodRow<'_>)| {
        let of_method = |one: &Measure| (*one, one.of_method(group, method.method));
        let values: Vec<_> = measures.iter().map(of_method).collect();
        Row {
            names: vec![name.clone()],
            cells: fidelity::cells(&values),
            class: None,
            failures: method.numbers.failures,
            marks: Mark::of(&method.numbers),
        }
    };
    let mut rows: Vec<Row> = methods.iter().map(row).collect();
    let contestants: Vec<(MethodClass, bool)> = (methods.iter())
        .map(|(_, method)| (method.class, method.complete))
        .collect();
    let columns = fidelity::columns(measures);
    mark_classes(&mut rows, &contestants, &columns);
    Table {
        title: format!(
            "{} of {whole}, input views, protocol {}, by component",
            LAYOUT.title, group.protocol
        ),
        names: vec!["Method".to_owned()],
        columns,
        rows,
        published: fidelity::published(papers, LAYOUT.published, measures, 1),
        notes: fidelity::notes(group, LAYOUT.note),
    }
}
