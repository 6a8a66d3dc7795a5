//! Agreement between two lists of boundaries, at a stated tolerance.

use std::collections::BTreeMap;

use omnilife_schemas::records::{Author, Boundary, LedgerAction, TimeRange};
use serde::Serialize;

use super::{Ledger, gap_seconds, resolve};

/// Agreement of `found` with `reference`.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Agreement {
    /// Boundaries closer than this count as the same, seconds.
    pub tolerance_seconds: f64,
    /// Boundaries of the reference.
    pub reference: usize,
    /// Boundaries of the other list.
    pub found: usize,
    /// Pairs that agree; each boundary is in one pair at most.
    pub matched: usize,
    /// Share of `found` that is in the reference; 1 if `found` is empty.
    pub precision: f64,
    /// Share of the reference that was found; 1 if the reference is empty.
    pub recall: f64,
    /// Harmonic mean of precision and recall; 0 where both are 0.
    pub f1: f64,
    /// Cohen's kappa over segments of twice the tolerance, each with a boundary or without: 1 for full agreement, 0 for
    /// chance.
    pub kappa: f64,
}

/// The agreement of every author of a ledger with the ledger's resolution, and of every pair of authors, in order of
/// name.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct AgreementEntry {
    /// Author whose boundaries count as the truth; `null` is the ledger's resolution.
    pub reference: Option<Author>,
    /// Author compared with it.
    pub author: Author,
    /// The numbers.
    #[serde(flatten)]
    pub agreement: Agreement,
}

/// Compares two lists of boundaries of a video, both in order of time.
pub fn compare(
    reference: &[Boundary],
    found: &[Boundary],
    range: TimeRange,
    tolerance_seconds: f64,
) -> Agreement {
    let matched = matches(reference, found, tolerance_seconds).len();
    let share = |part: usize, whole: usize| {
        if whole == 0 {
            1.0
        } else {
            part as f64 / whole as f64
        }
    };
    let (precision, recall) = (share(matched, found.len()), share(matched, reference.len()));
    let f1 = if precision + recall > 0.0 {
        2.0 * precision * recall / (precision + recall)
    } else {
        0.0
    };
    Agreement {
        tolerance_seconds,
        reference: reference.len(),
        found: found.len(),
        matched,
        precision,
        recall,
        f1,
        kappa: kappa(
            reference.len(),
            found.len(),
            matched,
            range,
            tolerance_seconds,
        ),
    }
}

/// Returns pairs of indices of boundaries that agree: as many as can be paired in order of time.
///
/// Both lists are in order and the tolerance is one number, so pairing each boundary of the
/// reference with the first free one within reach pairs as many as any other rule.
pub fn matches(
    reference: &[Boundary],
    found: &[Boundary],
    tolerance_seconds: f64,
) -> Vec<(usize, usize)> {
    let mut pairs = Vec::new();
    let mut next = 0;
    for (index, truth) in reference.iter().enumerate() {
        while next < found.len()
            && found[next].end_seconds < truth.begin_seconds - tolerance_seconds
        {
            next += 1;
        }
        if next < found.len() && gap_seconds(truth, &found[next]) <= tolerance_seconds {
            pairs.push((index, next));
            next += 1;
        }
    }
    pairs
}

/// Returns Cohen's kappa of a table of segments: boundary in both, in one alone, in neither.
fn kappa(
    reference: usize,
    found: usize,
    matched: usize,
    range: TimeRange,
    tolerance_seconds: f64,
) -> f64 {
    let segments = (range.duration_seconds() / (2.0 * tolerance_seconds.max(1e-3))).ceil();
    let total = segments.max((reference + found - matched) as f64).max(1.0);
    let share = |count: usize| count as f64 / total;
    let observed = 1.0 - share(reference + found - 2 * matched);
    let (p, q) = (share(reference), share(found));
    let by_chance = p * q + (1.0 - p) * (1.0 - q);
    if by_chance >= 1.0 {
        // Both always agree.
        1.0
    } else {
        (observed - by_chance) / (1.0 - by_chance)
    }
}

/// Returns the agreement of all authors with proposals or decisions on boundaries.
pub fn of_ledger(ledger: &Ledger, tolerance_seconds: f64) -> Vec<AgreementEntry> {
    let mut authors: Vec<&Author> = ledger
        .entries()
        .iter()
        .filter(|entry| {
            !matches!(
                entry.action,
                LedgerAction::Open { .. } | LedgerAction::Label(_)
            )
        })
        .map(|entry| &entry.author)
        .collect();
    authors.sort();
    authors.dedup();
    let resolution = resolve(ledger.entries());
    let mut table = Vec::new();
    for (index, author) in authors.iter().enumerate() {
        let own = stands_for(ledger, author);
        let mut compare_with = |reference: Option<&Author>, list: &[Boundary]| {
            table.push(AgreementEntry {
                reference: reference.cloned(),
                author: (*author).clone(),
                agreement: compare(list, &own, ledger.range(), tolerance_seconds),
            });
        };
        compare_with(None, &resolution);
        for (other, reference) in authors.iter().enumerate() {
            if other != index {
                compare_with(Some(reference), &stands_for(ledger, reference));
            }
        }
    }
    table
}

/// Returns the boundaries of an author, in order of time: those that they proposed, and those of any author that they
/// accepted or moved, without those that they rejected later.
fn stands_for(ledger: &Ledger, author: &Author) -> Vec<Boundary> {
    let proposed: BTreeMap<u64, &Boundary> = (ledger.entries().iter())
        .filter_map(|entry| match &entry.action {
            LedgerAction::Propose(boundary) => Some((entry.id, boundary)),
            _ => None,
        })
        .collect();
    // By the line of its proposal.
    let mut held: BTreeMap<u64, Boundary> = BTreeMap::new();
    for entry in ledger
        .entries()
        .iter()
        .filter(|entry| entry.author == *author)
    {
        match &entry.action {
            LedgerAction::Open { .. } | LedgerAction::Label(_) => {}
            LedgerAction::Propose(boundary) => {
                held.insert(entry.id, boundary.clone());
            }
            LedgerAction::Accept(id) => {
                let boundary = proposed.get(id).map(|&boundary| boundary.clone());
                held.extend(boundary.map(|boundary| (*id, boundary)));
            }
            LedgerAction::Move { id, boundary } => {
                held.insert(*id, boundary.clone());
            }
            LedgerAction::Reject(id) => {
                held.remove(id);
            }
        }
    }
    let mut list: Vec<Boundary> = held.into_values().collect();
    list.sort_by(|a, b| a.begin_seconds.total_cmp(&b.begin_seconds));
    list
}
