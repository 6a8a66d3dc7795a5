//! Resolution of a ledger: candidates, each with its authors, and the boundaries in force.
//!
//! The rules, in the order of their weight:
//! 1. The last decision of an expert on a boundary counts: accepted, rejected or moved. Proposals of experts are
//!    accepted.
//! 2. A seamless traversal that was not rejected keeps its segment whole: boundaries of detectors alone inside it do
//!    not hold.
//! 3. Every other proposal holds: predictions and annotations are merged.
//!
//! Proposals of different authors that lie within a tolerance are one candidate. Its time is an expert's, else a
//! detector's (frame-accurate, where people are late), else an annotator's. Its kind is a person's if that is more
//! specific than "cut" or "gradual".

use omnilife_schemas::records::{Author, Boundary, BoundaryKind, LedgerAction, LedgerEntry};

use super::gap_seconds;

/// Proposals of different authors closer than this are one boundary, seconds: about the delay of people pressing keys.
pub const MERGE_SECONDS: f64 = 0.5;

/// Status of a candidate.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Status {
    /// Undecided; it holds.
    Proposed,
    /// An expert accepted, moved or added it.
    Accepted,
    /// An expert rejected it.
    Rejected,
    /// It lies in a seamless traversal and only detectors found it.
    KeptWhole,
}

/// One boundary with all its authors.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
pub struct Candidate {
    /// Line of its first proposal: its id on the audit page.
    pub id: u64,
    /// Lines of all its proposals.
    pub lines: Vec<u64>,
    /// Authors of its proposals.
    pub authors: Vec<Author>,
    /// The boundary itself.
    pub boundary: Boundary,
    /// Its status.
    pub status: Status,
}

impl Candidate {
    /// Returns true if it counts as a boundary.
    pub fn holds(&self) -> bool {
        matches!(self.status, Status::Proposed | Status::Accepted)
    }

    fn only_detectors(&self) -> bool {
        self.authors
            .iter()
            .all(|author| matches!(author, Author::Detector(_)))
    }
}

/// Returns the boundaries in force, at which the video is cut, in order of time; overlapping ones are joined.
pub fn resolve(entries: &[LedgerEntry]) -> Vec<Boundary> {
    let mut holding: Vec<Boundary> = candidates(entries, MERGE_SECONDS)
        .into_iter()
        .filter(|candidate| candidate.holds() && candidate.boundary.kind.separates())
        .map(|candidate| candidate.boundary)
        .collect();
    holding.sort_by(|a, b| a.begin_seconds.total_cmp(&b.begin_seconds));
    let mut joined: Vec<Boundary> = Vec::new();
    for boundary in holding {
        match joined.last_mut() {
            Some(last) if boundary.begin_seconds < last.end_seconds => {
                last.end_seconds = last.end_seconds.max(boundary.end_seconds);
                last.score = last.score.max(boundary.score);
                if last.kind != BoundaryKind::IndoorOutdoor {
                    last.kind = match boundary.kind {
                        BoundaryKind::IndoorOutdoor => BoundaryKind::IndoorOutdoor,
                        _ => BoundaryKind::Gradual,
                    };
                }
            }
            _ => joined.push(boundary),
        }
    }
    joined
}

/// Returns all candidates with their status, in order of time.
pub fn candidates(entries: &[LedgerEntry], merge_seconds: f64) -> Vec<Candidate> {
    let mut found: Vec<Candidate> = Vec::new();
    for entry in entries {
        match &entry.action {
            LedgerAction::Open { .. } | LedgerAction::Label(_) => {}
            LedgerAction::Propose(boundary) => {
                propose(&mut found, entry, boundary, merge_seconds);
            }
            LedgerAction::Accept(id) => decide(&mut found, *id, Status::Accepted),
            LedgerAction::Reject(id) => decide(&mut found, *id, Status::Rejected),
            LedgerAction::Move { id, boundary } => {
                if let Some(candidate) = of_line(&mut found, *id) {
                    candidate.boundary = boundary.clone();
                    candidate.status = Status::Accepted;
                }
            }
        }
    }
    let whole: Vec<Boundary> = found
        .iter()
        .filter(|candidate| candidate.holds() && !candidate.boundary.kind.separates())
        .map(|candidate| candidate.boundary.clone())
        .collect();
    for candidate in &mut found {
        let is_inside = whole.iter().any(|segment| {
            segment.begin_seconds <= candidate.boundary.end_seconds
                && candidate.boundary.begin_seconds <= segment.end_seconds
        });
        if candidate.status == Status::Proposed
            && candidate.boundary.kind.separates()
            && candidate.only_detectors()
            && is_inside
        {
            candidate.status = Status::KeptWhole;
        }
    }
    found.sort_by(|a, b| {
        a.boundary
            .begin_seconds
            .total_cmp(&b.boundary.begin_seconds)
    });
    found
}

/// Joins the nearest candidate of another author, or creates a new one.
fn propose(
    found: &mut Vec<Candidate>,
    entry: &LedgerEntry,
    boundary: &Boundary,
    merge_seconds: f64,
) {
    let is_expert = matches!(entry.author, Author::Expert(_));
    let nearest = found
        .iter_mut()
        .filter(|candidate| {
            !candidate.authors.contains(&entry.author)
                && candidate.boundary.kind.separates() == boundary.kind.separates()
                && gap_seconds(&candidate.boundary, boundary) <= merge_seconds
        })
        .min_by(|a, b| {
            gap_seconds(&a.boundary, boundary).total_cmp(&gap_seconds(&b.boundary, boundary))
        });
    let Some(candidate) = nearest else {
        found.push(Candidate {
            id: entry.id,
            lines: vec![entry.id],
            authors: vec![entry.author.clone()],
            boundary: boundary.clone(),
            status: if is_expert {
                Status::Accepted
            } else {
                Status::Proposed
            },
        });
        return;
    };
    let kind = more_telling(candidate.boundary.kind, boundary.kind);
    if is_expert {
        candidate.boundary = boundary.clone();
        candidate.status = Status::Accepted;
    } else if candidate.status != Status::Accepted
        && candidate
            .authors
            .iter()
            .all(|author| matches!(author, Author::Annotator(_)))
        && matches!(entry.author, Author::Detector(_))
    {
        candidate.boundary = Boundary {
            kind,
            ..boundary.clone()
        };
    } else if candidate.status != Status::Accepted {
        candidate.boundary.kind = kind;
    }
    candidate.lines.push(entry.id);
    candidate.authors.push(entry.author.clone());
}

/// Returns the more specific kind; the first if neither is.
fn more_telling(first: BoundaryKind, second: BoundaryKind) -> BoundaryKind {
    let says_place = |kind| !matches!(kind, BoundaryKind::Cut | BoundaryKind::Gradual);
    if says_place(second) && !says_place(first) {
        second
    } else {
        first
    }
}

fn decide(found: &mut [Candidate], line: u64, status: Status) {
    if let Some(candidate) = of_line(found, line) {
        candidate.status = status;
    }
}

fn of_line(found: &mut [Candidate], line: u64) -> Option<&mut Candidate> {
    found
        .iter_mut()
        .find(|candidate| candidate.lines.contains(&line))
}
