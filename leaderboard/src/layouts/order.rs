//! The order of methods, as stated in the titles of tables: class by class, the best first.

use std::cmp::Ordering;

use omnilife_schemas::records::Direction;

use super::main_methods;
use crate::{
    format,
    group::{Group, MethodRow, ViewKind},
    numbers::Numbers,
};

/// Returns the score by which methods are ranked: PSNR of novel views, the only one that all papers print.
pub(crate) fn ranked_by(group: &Group<'_>) -> Option<usize> {
    group.quantity(ViewKind::Novel, "psnr")
}

/// Returns the score that orders methods: the ranked one, or else PSNR of input views.
fn ordered_by(group: &Group<'_>) -> Option<usize> {
    ranked_by(group).or_else(|| group.quantity(ViewKind::Input, "psnr"))
}

/// Returns the order of methods in words: `by novel PSNR, best first`.
pub(crate) fn order_in_words(group: &Group<'_>) -> String {
    match ordered_by(group) {
        Some(index) => {
            let (quantity, _) = &group.quantities[index];
            let metric = format::metric_title(&quantity.metric);
            format!("by {} {metric}, best first", quantity.kind.name())
        }
        None => "by name".to_owned(),
    }
}

/// Returns an order of results: complete ones first, the better score first, those without one last.
pub(crate) fn best_first(group: &Group<'_>) -> impl Fn(&Numbers, &Numbers) -> Ordering {
    let by = ordered_by(group).map(|index| (index, group.quantities[index].1));
    move |left: &Numbers, right: &Numbers| {
        let by_score = by.map_or(Ordering::Equal, |(index, direction)| {
            better_first(direction, left.scores[index], right.scores[index])
        });
        right.complete.cmp(&left.complete).then(by_score)
    }
}

/// Orders two scores, the better one first; a missing one comes last.
pub(super) fn better_first(
    direction: Direction,
    left: Option<f64>,
    right: Option<f64>,
) -> Ordering {
    match (left, right) {
        (Some(left), Some(right)) => match direction {
            Direction::HigherIsBetter => right.total_cmp(&left),
            Direction::LowerIsBetter => left.total_cmp(&right),
        },
        _ => right.is_some().cmp(&left.is_some()),
    }
}

/// Returns the methods without variants in the order of the tables; those that lack a scene or a complete result come
/// last in their class.
pub(crate) fn standings<'g, 'a>(group: &'g Group<'a>) -> Vec<&'g MethodRow<'a>> {
    let best_first = best_first(group);
    let mut methods = main_methods(group);
    methods.sort_by(|a, b| {
        let by_class = a.class.cmp(&b.class).then(b.complete.cmp(&a.complete));
        by_class.then_with(|| best_first(&a.numbers, &b.numbers))
    });
    methods
}
