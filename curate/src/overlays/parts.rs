//! Partial sums over a video, so that its shots can be judged once boundaries are confirmed after the pass.
//!
//! A step with a candidate cut is a part of its own; the steps between two candidates are one part. A false candidate
//! costs nothing: the parts of a shot are joined, which gives the sums over all its steps. A step over a confirmed
//! boundary belongs to no shot.
//!
//! Memory is bounded: of more than [`MOST_PARTS`] parts, the neighbours with the weakest candidates become one. A part
//! takes 32 bytes a pixel of the looked-at images, 4.2 MB at 512x256 whatever the size of the video: 100 MB at most.

use omnilife_schemas::records::{Boundary, TimeRange};

/// Largest number of parts: at most twelve cuts are told apart exactly.
const MOST_PARTS: usize = 24;

/// Sums over steps.
pub(super) trait Sums: Default {
    /// Adds the sums over later steps.
    fn join(&mut self, later: &Self);
}

/// Steps that follow each other, with their sums.
#[derive(Debug)]
pub(super) struct Part<S> {
    /// From the frame before its first step to the frame after its last.
    pub(super) range: TimeRange,
    steps: u32,
    /// Score of its strongest candidate cut; `None` without one.
    score: Option<f64>,
    pub(super) sums: S,
}

/// Parts of a video in order of time.
#[derive(Debug, Default)]
pub(super) struct Parts<S> {
    parts: Vec<Part<S>>,
}

impl<S: Sums> Part<S> {
    /// Makes a part without steps at the time of a frame.
    fn at(seconds: f64) -> Self {
        Self {
            range: TimeRange::new(seconds, seconds),
            steps: 0,
            score: None,
            sums: S::default(),
        }
    }

    fn join(&mut self, later: &Self) {
        self.range.end_seconds = later.range.end_seconds;
        self.steps += later.steps;
        self.score = strongest(self.score, later.score);
        self.sums.join(&later.sums);
    }
}

impl<S: Sums> Parts<S> {
    /// Adds a step between the frames at the ends of a range, with the score of a candidate cut in it.
    pub(super) fn add(
        &mut self,
        range: TimeRange,
        score: Option<f64>,
        sum_up: impl FnOnce(&mut S),
    ) {
        let is_candidate = |part: &Part<S>| part.score.is_some();
        if score.is_some() || self.parts.last().is_none_or(is_candidate) {
            let part = Part::at(range.begin_seconds);
            self.parts.push(Part { score, ..part });
        }
        if let Some(part) = self.parts.last_mut() {
            part.range.end_seconds = range.end_seconds;
            part.steps += 1;
            sum_up(&mut part.sums);
        }
        while self.parts.len() > MOST_PARTS {
            self.join_weakest();
        }
    }

    /// Makes one part of the two neighbours with the weakest candidates.
    fn join_weakest(&mut self) {
        let score =
            |pair: &[Part<S>]| strongest(pair[0].score, pair[1].score).unwrap_or(f64::NEG_INFINITY);
        let scores = self.parts.windows(2).map(score).enumerate();
        if let Some((at, _)) = scores.min_by(|a, b| a.1.total_cmp(&b.1)) {
            let later = self.parts.remove(at + 1);
            self.parts[at].join(&later);
        }
    }

    /// Judges each shot by the sums over its steps, in order of time. Shots between which there is no candidate are
    /// judged together. A shot of a single frame has no steps.
    pub(super) fn by_shot<T>(
        &self,
        boundaries: &[Boundary],
        judge: impl Fn(&Part<S>) -> T,
    ) -> Vec<T> {
        let Some(first) = self.parts.first() else {
            return Vec::new();
        };
        let mut judged = Vec::new();
        let mut shot = Part::at(first.range.begin_seconds);
        for part in &self.parts {
            if part.steps == 1 && is_over_boundary(part.range, boundaries) {
                judged.push(judge(&shot));
                shot = Part::at(part.range.end_seconds);
            } else {
                shot.join(part);
            }
        }
        judged.push(judge(&shot));
        judged
    }
}

/// Returns the number of the shot at an instant, from 0; a transition belongs to the nearer one.
pub(super) fn shot_at(boundaries: &[Boundary], seconds: f64) -> usize {
    let middle = |boundary: &Boundary| 0.5 * (boundary.begin_seconds + boundary.end_seconds);
    boundaries.partition_point(|boundary| middle(boundary) < seconds)
}

fn is_over_boundary(range: TimeRange, boundaries: &[Boundary]) -> bool {
    shot_at(boundaries, range.begin_seconds) < shot_at(boundaries, range.end_seconds)
}

fn strongest(one: Option<f64>, other: Option<f64>) -> Option<f64> {
    [one, other].into_iter().flatten().max_by(f64::total_cmp)
}

#[cfg(test)]
mod tests {
    use omnilife_schemas::records::BoundaryKind;

    use super::*;

    /// Numbers of steps in order.
    #[derive(Debug, Default, PartialEq)]
    struct Numbers(Vec<usize>);

    impl Sums for Numbers {
        fn join(&mut self, later: &Self) {
            self.0.extend(&later.0);
        }
    }

    /// Steps of a second, the first from 0 to 1 s, with candidates of these scores.
    fn parts(steps: usize, candidates: &[(usize, f64)]) -> Parts<Numbers> {
        let mut parts = Parts::default();
        for step in 0..steps {
            let range = TimeRange::new(step as f64, step as f64 + 1.0);
            let mut scores = candidates.iter().filter(|(at, _)| *at == step);
            let score = scores.next().map(|(_, score)| *score);
            parts.add(range, score, |sums: &mut Numbers| sums.0.push(step));
        }
        parts
    }

    /// Steps of each shot, with boundaries in the middle of these steps.
    fn shots(parts: &Parts<Numbers>, cuts: &[usize]) -> Vec<Vec<usize>> {
        let boundary = |&step: &usize| Boundary {
            begin_seconds: step as f64 + 0.4,
            end_seconds: step as f64 + 0.6,
            kind: BoundaryKind::Cut,
            score: 1.0,
        };
        let boundaries: Vec<Boundary> = cuts.iter().map(boundary).collect();
        parts.by_shot(&boundaries, |part| part.sums.0.clone())
    }

    #[test]
    fn false_candidates_cost_nothing() {
        let all: Vec<usize> = (0..9).collect();
        for candidates in [vec![], vec![(0, 1.0)], vec![(3, 1.0), (4, 0.5), (8, 2.0)]] {
            assert_eq!(
                shots(&parts(9, &candidates), &[]),
                std::slice::from_ref(&all)
            );
        }
    }

    #[test]
    fn a_step_over_a_confirmed_boundary_is_in_no_shot() {
        let parts = parts(9, &[(3, 1.0), (4, 1.0), (6, 1.0)]);
        assert_eq!(parts.parts.len(), 6);
        let two = [vec![0, 1, 2, 3], vec![5, 6, 7, 8]];
        assert_eq!(shots(&parts, &[4]), two);
        // A shot of one frame between two cuts.
        let three = [vec![0, 1, 2], vec![], vec![5, 6, 7, 8]];
        assert_eq!(shots(&parts, &[3, 4]), three);
    }

    #[test]
    fn shots_without_a_candidate_between_them_are_judged_together() {
        let parts = parts(9, &[(6, 1.0)]);
        let two = [vec![0, 1, 2, 3, 4, 5], vec![7, 8]];
        assert_eq!(shots(&parts, &[2, 6]), two);
    }

    #[test]
    fn the_weakest_candidates_are_given_up() {
        let count = 2 * MOST_PARTS;
        let candidates: Vec<_> = (0..count)
            .map(|number| (2 * number + 1, number as f64))
            .collect();
        let steps = 2 * count + 1;
        let parts = parts(steps, &candidates);
        assert_eq!(parts.parts.len(), MOST_PARTS);
        assert_eq!(shots(&parts, &[]), [(0..steps).collect::<Vec<_>>()]);
        let strongest = candidates[count - 1].0;
        assert_eq!(shots(&parts, &[strongest]).len(), 2);
        assert_eq!(shots(&parts, &[candidates[0].0]).len(), 1);
    }
}
