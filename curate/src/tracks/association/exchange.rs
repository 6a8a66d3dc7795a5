//! Exchanges between chains that raise their total likelihood: a greedy choice of the best chain takes sightings that
//! another one needs more.

use super::{LEAST_DETECTIONS, LONGEST_GAP_SECONDS, Search};

/// Sightings before and after an exchange that decide whether it is an improvement.
const WINDOW: usize = 6;
/// Smallest gain that counts (above rounding error).
const LEAST_GAIN: f64 = 1e-6;
/// Maximum number of rounds; each raises the total likelihood.
const ROUNDS: usize = 10;
/// Maximum number of passes over all pairs per round. Gains are measured in windows, so that long chains could be
/// exchanged back and forth.
const PASSES: usize = 20;
/// Largest distance of a continuation from a chain's prediction: for measurement errors, metres, and for acceleration
/// and turns, metres per square second.
const MEASURED: f64 = 1.5;
const TURNED: f64 = 3.0;

impl Search<'_> {
    /// Rearranges the sightings into likelier chains: tails are exchanged, cut off and joined, sightings are swapped,
    /// added and removed, as long as the sum of the scores grows.
    pub(super) fn exchanged(&self, mut chains: Vec<Vec<usize>>) -> Vec<Vec<usize>> {
        for _ in 0..ROUNDS {
            let before = chains.clone();
            self.exchange_tails(&mut chains);
            self.exchange_sightings(&mut chains);
            self.take_in(&mut chains);
            chains.retain(|chain| chain.len() >= LEAST_DETECTIONS);
            if chains == before {
                break;
            }
        }
        chains
    }

    /// Returns the log likelihood of a chain against no chain; 0 for an empty chain, minus infinity for an impossible
    /// one.
    fn score(&self, chain: &[usize]) -> f64 {
        let Some((&first, rest)) = chain.split_first() else {
            return 0.0;
        };
        let begin = Some(self.first(first));
        let end = rest.iter().fold(begin, |chain, &number| {
            chain.and_then(|chain| self.linked(&chain, number))
        });
        end.map_or(f64::NEG_INFINITY, |chain| chain.score)
    }

    /// Returns the score of `before` followed by `after`, near their junction.
    fn joined(&self, before: &[usize], after: &[usize]) -> f64 {
        let whole = before.len() + after.len();
        if whole < LEAST_DETECTIONS {
            return 0.0;
        }
        let near: Vec<usize> = before[before.len().saturating_sub(WINDOW)..]
            .iter()
            .chain(after.iter().take(WINDOW))
            .copied()
            .collect();
        self.score(&near)
    }

    /// Exchanges tails if that is an improvement, and cuts them off if they do not belong.
    fn exchange_tails(&self, chains: &mut Vec<Vec<usize>>) {
        let mut is_new = vec![true; chains.len()];
        for _ in 0..PASSES {
            let was_new = std::mem::replace(&mut is_new, vec![false; chains.len()]);
            for a in 0..was_new.len() {
                // A chain and an empty one: its tail becomes a chain of its own.
                if was_new[a]
                    && let Some([i, _]) = self.best_cut(&chains[a], &[])
                {
                    let tail = chains[a].split_off(i);
                    chains.push(tail);
                    is_new.push(true);
                    is_new[a] = true;
                }
                for b in 0..a {
                    let is_known = !(was_new[a] || was_new[b]);
                    if is_known || chains[a].is_empty() || chains[b].is_empty() {
                        continue;
                    }
                    let Some([i, j]) = self.best_cut(&chains[a], &chains[b]) else {
                        continue;
                    };
                    let (tail_a, tail_b) = (chains[a].split_off(i), chains[b].split_off(j));
                    chains[a].extend(tail_b);
                    chains[b].extend(tail_a);
                    (is_new[a], is_new[b]) = (true, true);
                }
            }
            if is_new.iter().all(|is_new| !is_new) {
                break;
            }
        }
        chains.retain(|chain| !chain.is_empty());
    }

    /// Returns the cut of two chains whose exchange of tails gains most; `None` if none gains.
    fn best_cut(&self, one: &[usize], other: &[usize]) -> Option<[usize; 2]> {
        let range = |chain: &[usize]| {
            let seconds = |at: Option<&usize>| at.map(|&number| self.sightings[number].seconds);
            Some([seconds(chain.first())?, seconds(chain.last())?])
        };
        if let (Some([begin, end]), Some([first, last])) = (range(one), range(other))
            && (first - end > LONGEST_GAP_SECONDS || begin - last > LONGEST_GAP_SECONDS)
        {
            return None;
        }
        let gains = self.cuts(one, other).into_iter().map(|[i, j]| {
            let gain = self.gain_of_tails(one, i, other, j);
            (gain, [i, j])
        });
        gains
            .filter(|(gain, _)| *gain > LEAST_GAIN)
            .max_by(|a, b| a.0.total_cmp(&b.0))
            .map(|(_, cut)| cut)
    }

    /// Returns common cuts of two chains in time: the number of sightings before each cut in either.
    fn cuts(&self, one: &[usize], other: &[usize]) -> Vec<[usize; 2]> {
        let frame = |chain: &[usize], at: usize| chain.get(at).map(|&number| self.frame_of[number]);
        let mut cuts = Vec::new();
        let (mut i, mut j) = (0, 0);
        while i < one.len() || j < other.len() {
            // Past the earlier of the two, or past both.
            let (of_one, of_other) = (frame(one, i), frame(other, j));
            let earliest = [of_one, of_other].into_iter().flatten().min();
            i += usize::from(of_one == earliest);
            j += usize::from(of_other == earliest);
            let is_end = i == one.len() && j == other.len();
            if !is_end
                && self.may_follow(&one[..i], &other[j..])
                && self.may_follow(&other[..j], &one[i..])
            {
                cuts.push([i, j]);
            }
        }
        cuts
    }

    /// Returns true if the last sighting of one is near enough to the first of another: within reach, and near its
    /// prediction.
    fn may_follow(&self, before: &[usize], after: &[usize]) -> bool {
        let (Some(&last), Some(&first)) = (before.last(), after.first()) else {
            return true;
        };
        if !self.is_in_reach(last, first) {
            return false;
        }
        let Some(&earlier) = before.iter().nth_back(1) else {
            return true;
        };
        let [earlier, last, first] = [earlier, last, first].map(|number| &self.sightings[number]);
        let velocity = (last.place - earlier.place) / (last.seconds - earlier.seconds);
        let gap = first.seconds - last.seconds;
        let foreseen = last.place + velocity * gap;
        let share = gap / (last.seconds - earlier.seconds);
        let slack =
            MEASURED * (1.0 + share) + TURNED * gap * (gap + last.seconds - earlier.seconds);
        first.place.distance_squared(foreseen) <= slack * slack
    }

    fn gain_of_tails(&self, one: &[usize], i: usize, other: &[usize], j: usize) -> f64 {
        let old = self.joined(&one[..i], &one[i..]) + self.joined(&other[..j], &other[j..]);
        let new = self.joined(&one[..i], &other[j..]) + self.joined(&other[..j], &one[i..]);
        new - old
    }

    /// Swaps the sightings of two chains in one frame.
    fn exchange_sightings(&self, chains: &mut [Vec<usize>]) {
        for a in 0..chains.len() {
            for b in 0..a {
                let ends = |chain: &[usize]| {
                    let frame = |at: Option<&usize>| at.map(|&number| self.frame_of[number]);
                    [frame(chain.first()), frame(chain.last())]
                };
                let ([a_first, a_last], [b_first, b_last]) = (ends(&chains[a]), ends(&chains[b]));
                if a_first > b_last || b_first > a_last {
                    continue;
                }
                for i in 0..chains[a].len() {
                    let frame = self.frame_of[chains[a][i]];
                    let j = chains[b].partition_point(|&number| self.frame_of[number] < frame);
                    let is_there = chains[b]
                        .get(j)
                        .is_some_and(|&number| self.frame_of[number] == frame);
                    if !is_there || !self.is_near(chains[a][i], chains[b][j]) {
                        continue;
                    }
                    let old = self.around(&chains[a], i) + self.around(&chains[b], j);
                    let (of_a, of_b) = (chains[a][i], chains[b][j]);
                    (chains[a][i], chains[b][j]) = (of_b, of_a);
                    let new = self.around(&chains[a], i) + self.around(&chains[b], j);
                    if new <= old + LEAST_GAIN {
                        (chains[a][i], chains[b][j]) = (of_a, of_b);
                    }
                }
            }
        }
    }

    /// Returns the score of a chain around one of its sightings.
    fn around(&self, chain: &[usize], at: usize) -> f64 {
        let end = (at + WINDOW + 1).min(chain.len());
        self.score(&chain[at.saturating_sub(WINDOW)..end])
    }

    /// Adds unassigned sightings to likely chains, and removes unlikely ones.
    fn take_in(&self, chains: &mut [Vec<usize>]) {
        let mut is_used = vec![false; self.sightings.len()];
        chains
            .iter()
            .flatten()
            .for_each(|&number| is_used[number] = true);
        for number in (0..self.sightings.len()).filter(|&number| !is_used[number]) {
            let mut best = (LEAST_GAIN, None);
            for (at, chain) in chains.iter().enumerate() {
                let frame = self.frame_of[number];
                let place = chain.partition_point(|&other| self.frame_of[other] < frame);
                let is_taken = chain
                    .get(place)
                    .is_some_and(|&other| self.frame_of[other] == frame);
                let reaches = self.may_follow(&chain[..place], &[number])
                    && self.may_follow(&[number], &chain[place..]);
                if is_taken || !reaches {
                    continue;
                }
                let old = self.joined(&chain[..place], &chain[place..]);
                let mut longer = chain.clone();
                longer.insert(place, number);
                let gain = self.around(&longer, place) - old;
                if gain > best.0 {
                    best = (gain, Some((at, place)));
                }
            }
            if let Some((at, place)) = best.1 {
                chains[at].insert(place, number);
            }
        }
        for chain in chains {
            let mut at = 0;
            while at < chain.len() && chain.len() > LEAST_DETECTIONS {
                let gain = self.joined(&chain[..at], &chain[at + 1..]) - self.around(chain, at);
                if gain > LEAST_GAIN {
                    chain.remove(at);
                } else {
                    at += 1;
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use glam::dvec2;

    use super::*;
    use crate::tracks::association::Sighting;

    /// Returns two cars that pass each other, sightings 0, 2, 4, ... of one and 1, 3, 5, ... of the other.
    fn passing() -> (Vec<Sighting>, Vec<Vec<usize>>) {
        let sightings = (0..20).map(|number| {
            let seconds = f64::from(number / 2);
            let direction = if number % 2 == 0 { 1.0 } else { -1.0 };
            Sighting {
                seconds,
                place: dvec2(direction * (7.0 * seconds - 33.0), 1.5 * direction),
                size: 3.0,
                is_cut: false,
            }
        });
        let frames = (0..10).map(|frame| vec![2 * frame, 2 * frame + 1]);
        (sightings.collect(), frames.collect())
    }

    #[test]
    fn tails_and_sightings_return_to_their_chains() {
        let (sightings, frames) = passing();
        let search = Search::new(&sightings, &frames);
        let truth: Vec<Vec<usize>> = (0..2)
            .map(|first| (first..20).step_by(2).collect())
            .collect();
        let [one, other] = [&truth[0], &truth[1]];
        let with_tail = |own: &[usize], tail: &[usize]| [&own[..5], &tail[5..]].concat();
        let mut exchanged = truth.clone();
        exchanged[0][4] = other[4];
        exchanged[1][4] = one[4];
        let mut without = truth.clone();
        without[0].remove(6);
        for wrong in [
            vec![with_tail(one, other), with_tail(other, one)],
            exchanged,
            without,
            vec![one[..5].to_vec(), one[5..].to_vec(), other.clone()],
        ] {
            let mut found = search.exchanged(wrong.clone());
            found.sort();
            assert_eq!(found, truth, "of {wrong:?}");
        }
    }
}
