//! Association of detections by object: the most likely chains over the clip.
//!
//! Objects that move two car lengths from frame to frame have no overlapping boxes in the image, but still follow their
//! velocity on the ground. Ambiguities between two cars resolve a frame later, when only one of the chains continues
//! evenly. So nothing is decided from frame to frame: every sighting keeps several chains that end at it, each with a
//! Kalman filter (`filter`). Whole chains are chosen by their likelihood ratio against as many false sightings (the
//! score of multiple hypothesis tracking; Blackman 2004, Eq. 4):
//!
//! ```text
//! score = sum_k ln(P N(z_k; predicted, S_k) / rho) + ln(sizes) + gaps ln(1 - P)
//! ```
//!
//! with the probability of detection `P` and the density `rho` of sightings on the ground; sizes enter by the
//! likelihood ratio of one object against two. Colours are not used: if one vehicle hides another, boxes show the wrong
//! one. The chain with the best score is taken with its sightings, then the best of the others, until none is likelier
//! than chance. Chains then exchange sightings as long as that raises their total likelihood (`exchange`). Chains of an
//! object that stopped for longer than the largest gap are joined at the end.

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
/// Largest speed of an object on a road, metres per second.
const FASTEST: f64 = 30.0;
/// Longest time for which a lost object is searched, seconds.
const LONGEST_GAP_SECONDS: f64 = 3.0;
/// Largest number of missed frames within a chain; longer gaps are stitched.
const MOST_MISSES: usize = 4;
/// Standard deviation of the logarithm of a size on the ground from frame to frame: boxes are upright in
/// the image, and cars turn.
const SIZE_SPREAD: f64 = 0.35;
/// Logarithm of the largest factor between sizes of any objects, either way.
const SIZE_RANGE: f64 = 1.2;
/// Standard deviation of a measured place, metres.
const MEASUREMENT: f64 = 0.4;
/// The same for a box cut off by the border of the image: its middle is not that of the object.
const MEASUREMENT_CUT: f64 = 1.2;
/// Log likelihood of each missed frame of a gap after the first: misses come together.
const NEXT_MISS: f64 = -0.3;
/// Number of chains kept at a sighting.
const KEPT: usize = 6;
/// Least score of a chain.
const LEAST_SCORE: f64 = 0.5;
/// Least number of detections of an object.
const LEAST_DETECTIONS: usize = 3;
/// Least area over which sightings are assumed to be spread, square metres.
const LEAST_AREA: f64 = 400.0;

/// A way of finding which detections are of one object.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Association {
    /// The likeliest chains on the ground over the whole clip; needs no weights. The default.
    GroundChains,
    /// From frame to frame in the image, by motion, overlap and the appearance network of `DeepSORT`
    /// (scripts/setup --models); appearance that changes nothing is left out.
    DeepSort,
}

/// All of them.
pub const ASSOCIATIONS: [Association; 2] = [Association::GroundChains, Association::DeepSort];

impl Association {
    /// Name on the command line.
    pub fn id(self) -> &'static str {
        match self {
            Self::GroundChains => "ground-chains",
            Self::DeepSort => "deepsort",
        }
    }
}

/// Returns how many of `count` sightings belong to another set of sightings in one grouping than in the other.
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
    /// True if the border of the image cuts it off.
    pub is_cut: bool,
}

impl Sighting {
    /// Returns the standard deviation of the place, metres.
    fn sigma(&self) -> f64 {
        if self.is_cut {
            MEASUREMENT_CUT
        } else {
            MEASUREMENT
        }
    }

    /// Returns the log likelihood ratio of a size for one object against two.
    fn size_likeness(&self, other: &Self) -> f64 {
        if self.is_cut || other.is_cut {
            return 0.0;
        }
        let ratio = (self.size / other.size).ln() / SIZE_SPREAD;
        -0.5 * ratio * ratio
            - (std::f64::consts::TAU.sqrt() * SIZE_SPREAD / (2.0 * SIZE_RANGE)).ln()
    }
}

/// Groups sightings by object; `frames` holds, in order of time, the numbers of the sightings of each frame. Every
/// group is in order of time; false sightings are in none.
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
    /// Its last sighting.
    last: usize,
    /// The chain before that, in the list of all.
    before: Option<usize>,
    filter: Filter,
    score: f64,
    count: usize,
}

/// The search for the likeliest chains.
struct Search<'a> {
    sightings: &'a [Sighting],
    frames: &'a [Vec<usize>],
    frame_of: Vec<usize>,
    /// Seconds of each frame; `None` for a frame without sightings.
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

    /// Returns the likeliest chains of unused sightings, no two of which share one, the best first. Chains that lost a
    /// sighting to a better one are left out: they are searched again.
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

    /// Returns for each sighting the likeliest chains that end at it.
    fn hypotheses(&self) -> Vec<Hypothesis> {
        let mut all: Vec<Hypothesis> = Vec::new();
        // Index of the first hypothesis of each frame.
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

    /// Starts a chain of one sighting.
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

    /// Returns true if an object could move from one sighting to a later one.
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

    /// Returns true if two sightings of one frame could be confused.
    fn is_near(&self, one: usize, other: usize) -> bool {
        let apart = self.sightings[one]
            .place
            .distance(self.sightings[other].place);
        apart <= 4.0 * MEASUREMENT_CUT
    }

    /// Returns a chain with a sighting appended; `None` if it cannot belong to it.
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

/// Returns the sightings of a chain, in order of time.
fn members(all: &[Hypothesis], at: usize) -> Vec<usize> {
    let mut numbers: Vec<usize> =
        std::iter::successors(Some(&all[at]), |one| one.before.map(|before| &all[before]))
            .map(|one| one.last)
            .collect();
    numbers.reverse();
    numbers
}

#[cfg(test)]
mod tests;
