//! Joining of chains of one object with a gap between them.

use super::{FASTEST, GATE, LONGEST_GAP_SECONDS, Sighting, filter::Filter};

/// Longest time without sightings of a stopped object, seconds.
const LONGEST_STOP_SECONDS: f64 = 8.0;
/// Largest movement of a stopped object, metres.
const STOPPED_METRES: f64 = 3.0;
/// Largest speed before a stop and after it, metres per second: filters lag behind.
const STOPPED_SPEED: f64 = 4.0;

/// Sightings of a chain that give its motion at an end.
const END: usize = 8;

/// Joins chains whose end and start fit each other: the best fits first.
pub(super) fn stitched(sightings: &[Sighting], chains: Vec<Vec<usize>>) -> Vec<Vec<usize>> {
    let mut fits = Vec::new();
    for (before, one) in chains.iter().enumerate() {
        for (after, other) in chains.iter().enumerate() {
            if let Some(cost) = gap_cost(sightings, one, other) {
                fits.push((cost, before, after));
            }
        }
    }
    fits.sort_by(|a, b| a.0.total_cmp(&b.0).then((a.1, a.2).cmp(&(b.1, b.2))));
    let mut next: Vec<Option<usize>> = vec![None; chains.len()];
    let mut is_continued = vec![false; chains.len()];
    for (_, before, after) in fits {
        if next[before].is_none() && !is_continued[after] {
            next[before] = Some(after);
            is_continued[after] = true;
        }
    }
    let begins = (0..chains.len()).filter(|&chain| !is_continued[chain]);
    begins
        .map(|first| {
            std::iter::successors(Some(first), |&chain| next[chain])
                .flat_map(|chain| chains[chain].iter().copied())
                .collect()
        })
        .collect()
}

/// Returns the misfit of the end of a chain and the start of another; `None` if they cannot be one.
///
/// Chains join in two ways: both lead towards each other, evenly, within a few seconds (the squared Mahalanobis
/// distance halfway between them in time), or the first stopped where the second starts.
fn gap_cost(sightings: &[Sighting], before: &[usize], after: &[usize]) -> Option<f64> {
    let (last, first) = (&sightings[*before.last()?], &sightings[*after.first()?]);
    let gap = first.seconds - last.seconds;
    if gap <= 0.0 || gap > LONGEST_STOP_SECONDS {
        return None;
    }
    // Another size is another vehicle, at any place.
    let unlike = -first.size_likeness(last).min(0.0);
    let between = first.place.distance(last.place);
    if between > STOPPED_METRES && (gap > LONGEST_GAP_SECONDS || between > FASTEST * gap) {
        return None;
    }
    let end = &before[before.len().saturating_sub(END)..];
    let forward = filtered(sightings, end.iter().copied())?;
    let backward = filtered(sightings, after.iter().take(END).rev().copied())?;
    let is_slow = forward.speed().min(backward.speed()) <= STOPPED_SPEED;
    if between <= STOPPED_METRES && is_slow {
        let cost = GATE * (between / STOPPED_METRES).powi(2) + unlike;
        return (cost <= GATE).then_some(cost);
    }
    if gap > LONGEST_GAP_SECONDS || between > FASTEST * gap {
        return None;
    }
    let middle = last.seconds + 0.5 * gap;
    let (forward, backward) = (forward.at(middle), backward.at(middle));
    let variance = forward.spread() + backward.spread();
    let cost = backward.place().distance_squared(forward.place()) / variance + unlike;
    (cost <= GATE).then_some(cost)
}

/// Returns a filter updated by some sightings, in their order, which may be backwards in time.
fn filtered(sightings: &[Sighting], mut members: impl Iterator<Item = usize>) -> Option<Filter> {
    let first = &sightings[members.next()?];
    let begin = Filter::new(first.seconds, first.place, first.sigma());
    Some(members.fold(begin, |filter, number| {
        let sighting = &sightings[number];
        filter
            .at(sighting.seconds)
            .updated(sighting.place, sighting.sigma())
    }))
}
