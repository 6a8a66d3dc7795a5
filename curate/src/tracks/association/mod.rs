//! Which detections are of one object: the chains over the clip that are the most likely.
//!
//! What moves two car lengths from frame to frame has no overlapping boxes in the image, and still is
//! where its velocity on the ground says. Which of two cars is meant shows a frame later, when only one
//! of the two goes on evenly. So nothing is decided from frame to frame: every sighting keeps several
//! chains that end at it, each with a Kalman filter (`filter`), and whole chains are chosen by how much
//! more likely they are than as many sightings of nothing (the score of multiple hypothesis tracking;
//! Blackman 2004, Eq. 4):
//!
//! ```text
//! score = sum_k ln(P N(z_k; predicted, S_k) / rho) + ln(sizes) + gaps ln(1 - P)
//! ```
//!
//! with the probability of detection `P` and the density `rho` of sightings on the ground; sizes
//! count by how likely they are of one object over of two. Colours do not count: where one vehicle hides
//! another, boxes show the wrong one. The chain
//! with the best score is taken with its sightings, then the best of the others, until none is left that
//! is likelier than nothing. Chains then exchange sightings as long as that makes all of them together
//! likelier (`exchange`). What stopped for longer than a chain may have gaps is joined at the end.

pub mod deepsort;
mod exchange;
mod filter;
mod stitching;

use glam::DVec2;

use filter::Filter;

/// Probability that an object is detected in a frame.
const DETECTED: f64 = 0.85;
/// Largest squared Mahalanobis distance of a link: 99 % of a chi-squared variable of 2 degrees.
const GATE: f64 = 9.21;
/// Nothing on a road is faster, metres per second.
const FASTEST: f64 = 30.0;
/// Objects are looked for so long after they were seen last, seconds.
const LONGEST_GAP_SECONDS: f64 = 3.0;
/// And over so many frames at most while chains are made; longer gaps are stitched.
const MOST_MISSES: usize = 4;
/// Standard deviation of the logarithm of a size on the ground from frame to frame: boxes are upright in
/// the image, and cars turn.
const SIZE_SPREAD: f64 = 0.35;
/// Sizes of anything differ by this factor's logarithm, either way.
const SIZE_RANGE: f64 = 1.2;
/// Standard deviation of a measured place, metres.
const MEASUREMENT: f64 = 0.4;
/// Of one whose box is cut off by the border of the image: its middle is not that of the object.
const MEASUREMENT_CUT: f64 = 1.2;
/// Each frame of a gap after the first: misses come together.
const NEXT_MISS: f64 = -0.3;
/// Chains that are kept at a sighting.
const KEPT: usize = 6;
/// Least score of a chain.
const LEAST_SCORE: f64 = 0.5;
/// Detections that an object needs.
const LEAST_DETECTIONS: usize = 3;
/// Least area that sightings are taken to be spread over, square metres.
const LEAST_AREA: f64 = 400.0;

/// A way of finding which detections are of one object.
#[derive(Debug, Clone, Copy)]
pub struct Association {
    /// Name on the command line.
    pub id: &'static str,
    /// What it does and when it is right.
    pub about: &'static str,
}

/// The default.
pub const GROUND_CHAINS: &str = "ground-chains";
/// That of a network.
pub const DEEPSORT: &str = "deepsort";

/// All of them.
pub const ASSOCIATIONS: &[Association] = &[
    Association {
        id: GROUND_CHAINS,
        about: "the likeliest chains on the ground over the whole clip; needs no weights",
    },
    Association {
        id: DEEPSORT,
        about: "from frame to frame in the image, by motion, overlap and the appearance network of DeepSORT \
                (scripts/setup --models); appearance that changes nothing is left out",
    },
];

/// How many of `count` sightings belong to another set of sightings in one grouping than in another.
pub fn changed(one: &[Vec<usize>], other: &[Vec<usize>], count: usize) -> usize {
    let group_of = |groups: &[Vec<usize>]| {
        let mut group_of: Vec<Option<Vec<usize>>> = vec![None; count];
        for group in groups {
            group
                .iter()
                .for_each(|&at| group_of[at] = Some(group.clone()));
        }
        group_of
    };
    let pairs = group_of(one).into_iter().zip(group_of(other));
    pairs.filter(|(one, other)| one != other).count()
}

/// A place on the ground at a time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sighting {
    /// Seconds.
    pub seconds: f64,
    /// Metres.
    pub place: DVec2,
    /// Square root of the area of its box on the ground, metres.
    pub size: f64,
    /// Whether the border of the image cuts it off.
    pub is_cut: bool,
}

impl Sighting {
    /// Standard deviation of the place, metres.
    fn sigma(&self) -> f64 {
        if self.is_cut {
            MEASUREMENT_CUT
        } else {
            MEASUREMENT
        }
    }

    /// How much likelier a size is of one object than of two, as a logarithm.
    fn size_likeness(&self, other: &Self) -> f64 {
        if self.is_cut || other.is_cut {
            return 0.0;
        }
        let ratio = (self.size / other.size).ln() / SIZE_SPREAD;
        -0.5 * ratio * ratio
            - (std::f64::consts::TAU.sqrt() * SIZE_SPREAD / (2.0 * SIZE_RANGE)).ln()
    }
}

/// Groups sightings by object; `frames` holds, in order of time, the numbers of the sightings of each
/// frame. Every group is in order of time; sightings of nothing that lasts are in none.
pub fn associate(sightings: &[Sighting], frames: &[Vec<usize>]) -> Vec<Vec<usize>> {
    let mut search = Search::new(sightings, frames);
    let mut chains = Vec::new();
    loop {
        let found = search.best();
        if found.is_empty() {
            break;
        }
        for chain in found {
            chain
                .iter()
                .for_each(|&number| search.is_used[number] = true);
            chains.push(chain);
        }
    }
    let chains = search.exchanged(chains);
    let mut groups = stitching::stitched(sightings, chains);
    groups.sort();
    groups
}

/// A chain of sightings that ends at one.
#[derive(Debug, Clone, Copy)]
struct Hypothesis {
    /// The sighting that it ends at.
    last: usize,
    /// The chain before that, among all.
    before: Option<usize>,
    filter: Filter,
    score: f64,
    count: usize,
}

/// The search for the likeliest chains.
struct Search<'a> {
    sightings: &'a [Sighting],
    frames: &'a [Vec<usize>],
    /// The frame of each sighting.
    frame_of: Vec<usize>,
    /// Seconds of each frame; `None` where nothing was seen.
    seconds: Vec<Option<f64>>,
    /// Logarithm of the density of sightings, per square metre and frame.
    log_density: f64,
    is_used: Vec<bool>,
}

impl<'a> Search<'a> {
    fn new(sightings: &'a [Sighting], frames: &'a [Vec<usize>]) -> Self {
        let (mut low, mut high) = (DVec2::INFINITY, DVec2::NEG_INFINITY);
        for sighting in sightings {
            low = low.min(sighting.place);
            high = high.max(sighting.place);
        }
        let area = if sightings.is_empty() {
            LEAST_AREA
        } else {
            ((high - low).x * (high - low).y).max(LEAST_AREA)
        };
        let per_frame = sightings.len() as f64 / frames.len().max(1) as f64;
        let mut frame_of = vec![0; sightings.len()];
        for (frame, seen) in frames.iter().enumerate() {
            seen.iter().for_each(|&number| frame_of[number] = frame);
        }
        Self {
            sightings,
            frames,
            frame_of,
            seconds: frames
                .iter()
                .map(|seen| Some(sightings[*seen.first()?].seconds))
                .collect(),
            log_density: (per_frame.max(1.0) / area).ln(),
            is_used: vec![false; sightings.len()],
        }
    }

    /// The likeliest chains of what is not used, no two of which share a sighting, the best first. Chains
    /// that lost a sighting to a better one are not among them: they are looked for again.
    fn best(&self) -> Vec<Vec<usize>> {
        let all = self.hypotheses();
        let mut order: Vec<usize> = (0..all.len())
            .filter(|&at| all[at].count >= LEAST_DETECTIONS && all[at].score >= LEAST_SCORE)
            .collect();
        order.sort_by(|&a, &b| all[b].score.total_cmp(&all[a].score).then(a.cmp(&b)));
        // A chain in conflict hides its sightings from worse ones: they are decided on a later round.
        let mut is_claimed = vec![false; self.sightings.len()];
        let mut chains = Vec::new();
        for at in order {
            let members = members(&all, at);
            let is_free = members.iter().all(|&number| !is_claimed[number]);
            members.iter().for_each(|&number| is_claimed[number] = true);
            if is_free {
                chains.push(members);
            }
        }
        chains
    }

    /// For each sighting the likeliest chains that end at it.
    fn hypotheses(&self) -> Vec<Hypothesis> {
        let mut all: Vec<Hypothesis> = Vec::new();
        // Where the hypotheses of each frame begin.
        let mut begins: Vec<usize> = Vec::new();
        for (frame, seen) in self.frames.iter().enumerate() {
            begins.push(all.len());
            let Some(seconds) = self.seconds[frame] else {
                continue;
            };
            let first = (0..frame)
                .rev()
                .take(MOST_MISSES + 1)
                .take_while(|&other| {
                    self.seconds[other].is_none_or(|then| seconds - then <= LONGEST_GAP_SECONDS)
                })
                .last();
            for &number in seen.iter().filter(|&&number| !self.is_used[number]) {
                let mut ending = vec![self.first(number)];
                for earlier in first.into_iter().flat_map(|first| first..frame) {
                    let linked = (begins[earlier]..begins[earlier + 1]).filter_map(|before| {
                        let linked = self.linked(&all[before], number)?;
                        Some(Hypothesis {
                            before: Some(before),
                            ..linked
                        })
                    });
                    ending.extend(linked);
                }
                ending.sort_by(|a, b| b.score.total_cmp(&a.score));
                ending.truncate(KEPT);
                all.extend(ending);
            }
        }
        all
    }

    /// A chain of one sighting.
    fn first(&self, number: usize) -> Hypothesis {
        let sighting = &self.sightings[number];
        Hypothesis {
            last: number,
            before: None,
            filter: Filter::new(sighting.seconds, sighting.place, sighting.sigma()),
            score: 0.0,
            count: 1,
        }
    }

    /// Whether anything could go from one sighting to a later one.
    fn is_in_reach(&self, earlier: usize, later: usize) -> bool {
        if self.frame_of[later] > self.frame_of[earlier] + MOST_MISSES + 1 {
            return false;
        }
        let (earlier, later) = (&self.sightings[earlier], &self.sightings[later]);
        let gap = later.seconds - earlier.seconds;
        let reach = FASTEST * gap + 4.0 * MEASUREMENT_CUT;
        gap > 0.0
            && gap <= LONGEST_GAP_SECONDS
            && later.place.distance_squared(earlier.place) <= reach * reach
    }

    /// Whether two sightings of one frame could be taken for each other.
    fn is_near(&self, one: usize, other: usize) -> bool {
        let apart = self.sightings[one]
            .place
            .distance(self.sightings[other].place);
        apart <= 4.0 * MEASUREMENT_CUT
    }

    /// A chain with a sighting behind it; `None` where it cannot be of it.
    fn linked(&self, chain: &Hypothesis, number: usize) -> Option<Hypothesis> {
        if !self.is_in_reach(chain.last, number) {
            return None;
        }
        let misses = self.frame_of[number] - self.frame_of[chain.last] - 1;
        let (sighting, last) = (&self.sightings[number], &self.sightings[chain.last]);
        let foreseen = chain.filter.at(sighting.seconds);
        let (squared, variance) = foreseen.distance(sighting.place, sighting.sigma());
        if squared > GATE {
            return None;
        }
        let normal = -0.5 * squared - (std::f64::consts::TAU * variance).ln();
        let of_gap = if misses == 0 {
            0.0
        } else {
            (1.0 - DETECTED).ln() + NEXT_MISS * (misses - 1) as f64
        };
        let likeness = sighting.size_likeness(last);
        let score = chain.score + DETECTED.ln() + normal - self.log_density + likeness + of_gap;
        score.is_finite().then(|| Hypothesis {
            last: number,
            before: None,
            filter: foreseen.updated(sighting.place, sighting.sigma()),
            score,
            count: chain.count + 1,
        })
    }
}

/// The sightings of a chain, in order of time.
fn members(all: &[Hypothesis], at: usize) -> Vec<usize> {
    let mut numbers: Vec<usize> =
        std::iter::successors(Some(&all[at]), |one| one.before.map(|before| &all[before]))
            .map(|one| one.last)
            .collect();
    numbers.reverse();
    numbers
}

#[cfg(test)]
mod tests {
    use glam::dvec2;

    use super::*;

    /// Sightings of objects `(begin, velocity)` at some frames, less those that `is_missed`.
    fn seen(
        objects: &[(DVec2, DVec2)],
        frames: usize,
        interval: f64,
        is_missed: impl Fn(usize, usize) -> bool,
    ) -> (Vec<Sighting>, Vec<Vec<usize>>, Vec<usize>) {
        let (mut sightings, mut by_frame, mut truth) = (Vec::new(), Vec::new(), Vec::new());
        for frame in 0..frames {
            let mut numbers = Vec::new();
            let seconds = frame as f64 * interval;
            for (object, &(begin, velocity)) in objects.iter().enumerate() {
                if !is_missed(frame, object) {
                    numbers.push(sightings.len());
                    truth.push(object);
                    sightings.push(Sighting {
                        seconds,
                        place: begin + velocity * seconds,
                        size: 3.0,
                        is_cut: false,
                    });
                }
            }
            by_frame.push(numbers);
        }
        (sightings, by_frame, truth)
    }

    #[test]
    fn what_belongs_elsewhere_is_counted() {
        let one = [vec![0, 1, 2], vec![3, 4]];
        assert_eq!(changed(&one, &one, 6), 0);
        assert_eq!(changed(&one, &[vec![3, 4], vec![0, 1, 2]], 6), 0);
        // 2 has gone to 3 and 4: all five are with others now.
        assert_eq!(changed(&one, &[vec![0, 1], vec![2, 3, 4]], 6), 5);
        assert_eq!(changed(&one, &[vec![0, 1, 2], vec![3, 4, 5]], 6), 3);
    }

    #[test]
    fn fast_objects_that_cross_keep_their_identity() {
        let objects = [
            (dvec2(-40.0, 0.0), dvec2(8.0, 0.0)),
            (dvec2(40.0, 3.0), dvec2(-8.0, 0.0)),
            (dvec2(0.5, -40.0), dvec2(0.0, 8.0)),
        ];
        let missed = |frame: usize, object: usize| (frame * 7 + object * 3) % 9 == 4;
        let (sightings, frames, truth) = seen(&objects, 11, 1.0, missed);
        let groups = associate(&sightings, &frames);
        assert_eq!(groups.len(), 3, "{groups:?}");
        for group in groups {
            assert!(group.iter().all(|&number| truth[number] == truth[group[0]]));
        }
    }

    #[test]
    fn a_gap_is_stitched_and_one_too_long_is_not() {
        let object = [(dvec2(0.0, 0.0), dvec2(5.0, 1.0))];
        let gone =
            |from: usize, to: usize| move |frame: usize, _: usize| (from..to).contains(&frame);
        let (sightings, frames, _) = seen(&object, 20, 0.5, gone(6, 10));
        assert_eq!(associate(&sightings, &frames).len(), 1);
        let (sightings, frames, _) = seen(&object, 30, 0.5, gone(8, 18));
        assert_eq!(associate(&sightings, &frames).len(), 2);
    }

    #[test]
    fn what_is_seen_once_or_twice_is_nothing() {
        let object = [(DVec2::ZERO, DVec2::X)];
        for count in [0, 1, 2] {
            let (sightings, frames, _) = seen(&object, count, 1.0, |_, _| false);
            assert!(associate(&sightings, &frames).is_empty());
        }
    }

    /// Every chain that there is, for a case that can be listed.
    #[test]
    fn the_first_chain_is_the_best_of_all() {
        let objects = [
            (dvec2(-8.0, 0.0), dvec2(7.0, 0.4)),
            (dvec2(8.0, 2.0), dvec2(-6.0, 0.0)),
            (dvec2(0.0, -9.0), dvec2(0.3, 6.0)),
        ];
        let missed = |frame: usize, object: usize| frame == 2 && object == 0;
        let (sightings, frames, _) = seen(&objects, 4, 1.0, missed);
        let search = Search::new(&sightings, &frames);
        let mut all: Vec<Hypothesis> = Vec::new();
        let mut at = 0;
        let firsts = (0..sightings.len()).map(|number| search.first(number));
        all.extend(firsts);
        while at < all.len() {
            for number in 0..sightings.len() {
                let linked = search.linked(&all[at], number).map(|linked| Hypothesis {
                    before: Some(at),
                    ..linked
                });
                all.extend(linked);
            }
            at += 1;
        }
        let best = (0..all.len())
            .filter(|&at| all[at].count >= LEAST_DETECTIONS)
            .max_by(|&a, &b| all[a].score.total_cmp(&all[b].score));
        let best = best.map(|at| members(&all, at));
        assert_eq!(search.best().first().cloned(), best);
    }

    /// A car that is not seen while it waits at a light is one car; another one that comes later is not.
    #[test]
    fn what_stops_is_found_again_at_its_place() {
        // 6 m/s, down to nothing from 4 s to 6 s, and up again from 12 s to 14 s.
        let along = |seconds: f64| {
            let slowing = (seconds.min(6.0) - 4.0).max(0.0);
            let starting = (seconds - 12.0).clamp(0.0, 2.0);
            let gone = (seconds - 14.0).max(0.0);
            6.0 * seconds.min(6.0) - 1.5 * slowing * slowing
                + 1.5 * starting * starting
                + 6.0 * gone
        };
        let sighting = |seconds: f64, y: f64| Sighting {
            seconds,
            place: dvec2(along(seconds), y),
            size: 3.0,
            is_cut: false,
        };
        let times = || (0..=6).chain(12..18).map(f64::from);
        let one_by_one: Vec<Vec<usize>> = (0..13).map(|number| vec![number]).collect();
        let one: Vec<Sighting> = times().map(|time| sighting(time, 0.0)).collect();
        assert_eq!(associate(&one, &one_by_one).len(), 1);
        let other: Vec<Sighting> = times()
            .map(|time| sighting(time, if time > 8.0 { 7.0 } else { 0.0 }))
            .collect();
        assert_eq!(associate(&other, &one_by_one).len(), 2);
    }

    /// A lorry and a car that meet do not change places.
    #[test]
    fn sizes_tell_what_places_do_not() {
        let mut sightings = Vec::new();
        let mut frames = Vec::new();
        for frame in 0..8 {
            let seconds = f64::from(frame);
            frames.push(vec![2 * frame as usize, 2 * frame as usize + 1]);
            for (side, size) in [(1.0, 2.6), (-1.0, 5.5)] {
                sightings.push(Sighting {
                    seconds,
                    place: dvec2(5.0 * seconds, side * 0.1 * (f64::from(frame) - 3.5)),
                    size,
                    is_cut: false,
                });
            }
        }
        let groups = associate(&sightings, &frames);
        assert_eq!(groups.len(), 2, "{groups:?}");
        for group in groups {
            assert!(
                group.iter().all(|&number| number % 2 == group[0] % 2),
                "{group:?}"
            );
        }
    }
}
