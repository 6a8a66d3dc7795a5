//! Which detections are of one object: a Kalman filter per object on the ground, the Hungarian method
//! from frame to frame, and stitching of what was torn by misses.
//!
//! The state is `(x, y, vx, vy)` in metres and metres per second; velocities are constant but for white
//! acceleration. What moves two car lengths from frame to frame has no overlapping boxes in the image,
//! and still is where its velocity on the ground says.

use glam::{DMat2, DMat4, DVec2, DVec4, dvec2};

use omnilife_schemas::assignment::assign;

/// Standard deviation of the acceleration, metres per square second.
const ACCELERATION: f64 = 2.0;
/// Standard deviation of a measured position, metres.
const MEASUREMENT: f64 = 0.5;
/// Standard deviation of the first velocity, metres per second.
const FIRST_SPEED: f64 = 6.0;
/// Largest squared Mahalanobis distance of a match: 99 % of a chi-squared variable of 2 degrees.
const GATE: f64 = 9.21;
/// Objects are looked for so long after they were seen last, seconds.
const LONGEST_GAP_SECONDS: f64 = 3.0;
/// Detections that an object needs.
const LEAST_DETECTIONS: usize = 3;

/// A place on the ground at a time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sighting {
    /// Seconds.
    pub seconds: f64,
    /// Metres.
    pub place: DVec2,
}

/// A filter's state.
#[derive(Debug, Clone, Copy)]
struct Filter {
    seconds: f64,
    state: DVec4,
    covariance: DMat4,
}

impl Filter {
    fn new(sighting: &Sighting) -> Self {
        let (place, speed) = (MEASUREMENT * MEASUREMENT, FIRST_SPEED * FIRST_SPEED);
        Self {
            seconds: sighting.seconds,
            state: DVec4::new(sighting.place.x, sighting.place.y, 0.0, 0.0),
            covariance: DMat4::from_diagonal(DVec4::new(place, place, speed, speed)),
        }
    }

    /// Where it will be.
    fn at(&self, seconds: f64) -> Self {
        let dt = seconds - self.seconds;
        let mut transition = DMat4::IDENTITY;
        transition.z_axis.x = dt;
        transition.w_axis.y = dt;
        // White acceleration, integrated once and twice.
        let q = ACCELERATION * ACCELERATION;
        let (of_place, mixed, of_speed) = (
            q * dt.powi(3).abs() / 3.0,
            q * dt * dt.abs() / 2.0,
            q * dt.abs(),
        );
        let mut noise = DMat4::from_diagonal(DVec4::new(of_place, of_place, of_speed, of_speed));
        noise.x_axis.z = mixed;
        noise.z_axis.x = mixed;
        noise.y_axis.w = mixed;
        noise.w_axis.y = mixed;
        Self {
            seconds,
            state: transition * self.state,
            covariance: transition * self.covariance * transition.transpose() + noise,
        }
    }

    fn place(&self) -> DVec2 {
        dvec2(self.state.x, self.state.y)
    }

    /// Covariance of the difference to another place, whose own is `more`.
    fn spread(&self, more: f64) -> DMat2 {
        let p = &self.covariance;
        DMat2::from_cols(
            dvec2(p.x_axis.x + more, p.x_axis.y),
            dvec2(p.y_axis.x, p.y_axis.y + more),
        )
    }

    /// Squared Mahalanobis distance of a place, and the logarithm of the spread's determinant.
    fn distance(&self, place: DVec2, more: f64) -> (f64, f64) {
        let spread = self.spread(more);
        let difference = place - self.place();
        (
            difference.dot(spread.inverse() * difference),
            spread.determinant().ln(),
        )
    }

    /// With what was seen taken in.
    fn updated(&self, place: DVec2) -> Self {
        let inverse = self.spread(MEASUREMENT * MEASUREMENT).inverse();
        let p = &self.covariance;
        let columns = [p.x_axis, p.y_axis];
        let gain =
            [0, 1].map(|axis| columns[0] * inverse.col(axis).x + columns[1] * inverse.col(axis).y);
        let difference = place - self.place();
        let mut taken = DMat4::ZERO;
        taken.x_axis = gain[0];
        taken.y_axis = gain[1];
        Self {
            seconds: self.seconds,
            state: self.state + gain[0] * difference.x + gain[1] * difference.y,
            covariance: *p - taken * *p,
        }
    }
}

/// A chain of sightings while it is being built.
#[derive(Debug, Clone)]
struct Chain {
    filter: Filter,
    /// Numbers of sightings.
    members: Vec<usize>,
}

/// Groups sightings by object; `frames` holds, in order of time, the numbers of the sightings of each
/// frame. Every group is in order of time; sightings of nothing that lasts are in none.
pub fn associate(sightings: &[Sighting], frames: &[Vec<usize>]) -> Vec<Vec<usize>> {
    let chains = stitched(sightings, chained(sightings, frames));
    let mut groups: Vec<Vec<usize>> = chains
        .into_iter()
        .filter(|members| members.len() >= LEAST_DETECTIONS)
        .collect();
    groups.sort();
    groups
}

/// Chains from frame to frame.
fn chained(sightings: &[Sighting], frames: &[Vec<usize>]) -> Vec<Vec<usize>> {
    let (mut open, mut closed): (Vec<Chain>, Vec<Vec<usize>>) = (Vec::new(), Vec::new());
    for seen in frames {
        let Some(seconds) = seen.first().map(|&first| sightings[first].seconds) else {
            continue;
        };
        let (kept, lost): (Vec<Chain>, Vec<Chain>) = open.into_iter().partition(|chain| {
            let last = chain
                .members
                .last()
                .map_or(seconds, |&last| sightings[last].seconds);
            seconds - last <= LONGEST_GAP_SECONDS
        });
        closed.extend(lost.into_iter().map(|chain| chain.members));
        open = kept;
        for chain in &mut open {
            chain.filter = chain.filter.at(seconds);
        }
        let matches = matched(&open, sightings, seen);
        let mut is_taken = vec![false; seen.len()];
        for (chain, matched) in open.iter_mut().zip(matches) {
            if let Some(column) = matched {
                is_taken[column] = true;
                chain.filter = chain.filter.updated(sightings[seen[column]].place);
                chain.members.push(seen[column]);
            }
        }
        let new = seen.iter().zip(is_taken).filter(|(_, is_taken)| !is_taken);
        open.extend(new.map(|(&number, _)| Chain {
            filter: Filter::new(&sightings[number]),
            members: vec![number],
        }));
    }
    closed.extend(open.into_iter().map(|chain| chain.members));
    closed
}

/// For each chain, the column of its match among `seen`.
fn matched(open: &[Chain], sightings: &[Sighting], seen: &[usize]) -> Vec<Option<usize>> {
    // A column of its own for each chain that has no match: as dear as a match at the gate.
    let columns = seen.len() + open.len();
    let costs: Vec<Vec<f64>> = open
        .iter()
        .enumerate()
        .map(|(row, chain)| {
            let more = MEASUREMENT * MEASUREMENT;
            let (_, spread) = chain.filter.distance(chain.filter.place(), more);
            let of_seen = seen.iter().map(|&number| {
                let (squared, _) = chain.filter.distance(sightings[number].place, more);
                if squared <= GATE {
                    squared + spread
                } else {
                    FORBIDDEN
                }
            });
            let of_none = (0..open.len()).map(|other| {
                if other == row {
                    GATE + spread
                } else {
                    FORBIDDEN
                }
            });
            of_seen.chain(of_none).collect()
        })
        .collect();
    let assigned = assign(&costs, columns);
    assigned
        .into_iter()
        .enumerate()
        .map(|(row, column)| {
            column.filter(|&column| column < seen.len() && costs[row][column] < FORBIDDEN)
        })
        .collect()
}

/// More than any sum of costs.
const FORBIDDEN: f64 = 1e9;

/// Chains whose end and beginning fit each other, as one.
fn stitched(sightings: &[Sighting], mut chains: Vec<Vec<usize>>) -> Vec<Vec<usize>> {
    loop {
        let costs: Vec<Vec<f64>> = chains
            .iter()
            .map(|before| {
                let of_others = chains
                    .iter()
                    .map(|after| gap_cost(sightings, before, after).unwrap_or(FORBIDDEN));
                let of_none = std::iter::repeat_n(GATE, chains.len());
                of_others.chain(of_none).collect()
            })
            .collect();
        let mut next: Vec<Option<usize>> = assign(&costs, 2 * chains.len())
            .into_iter()
            .map(|column| column.filter(|&column| column < chains.len()))
            .collect();
        for (row, next) in next.iter_mut().enumerate() {
            *next = next.filter(|&column| costs[row][column] < FORBIDDEN);
        }
        if next.iter().all(Option::is_none) {
            return chains;
        }
        let mut is_continued = vec![false; chains.len()];
        next.iter()
            .flatten()
            .for_each(|&after| is_continued[after] = true);
        let mut joined = Vec::new();
        for first in (0..chains.len()).filter(|&chain| !is_continued[chain]) {
            let (mut members, mut at) = (Vec::new(), Some(first));
            while let Some(chain) = at {
                members.append(&mut chains[chain]);
                at = next[chain];
            }
            joined.push(members);
        }
        chains = joined;
    }
}

/// Squared Mahalanobis distance between where a chain goes and where another comes from, halfway
/// between them in time; `None` where they cannot be one.
fn gap_cost(sightings: &[Sighting], before: &[usize], after: &[usize]) -> Option<f64> {
    let (&last, &first) = (before.last()?, after.first()?);
    let gap = sightings[first].seconds - sightings[last].seconds;
    if gap <= 0.0 || gap > LONGEST_GAP_SECONDS {
        return None;
    }
    let middle = sightings[last].seconds + 0.5 * gap;
    let forward = filtered(sightings, before.iter().copied())?.at(middle);
    let backward = filtered(sightings, after.iter().rev().copied())?.at(middle);
    let spread = forward.spread(0.0) + backward.spread(0.0);
    let difference = backward.place() - forward.place();
    let squared = difference.dot(spread.inverse() * difference);
    (squared <= GATE).then_some(squared)
}

/// A filter that has seen all of some sightings, in their order, be it back in time.
fn filtered(sightings: &[Sighting], mut members: impl Iterator<Item = usize>) -> Option<Filter> {
    let first = &sightings[members.next()?];
    Some(members.fold(Filter::new(first), |filter, number| {
        let sighting = &sightings[number];
        filter.at(sighting.seconds).updated(sighting.place)
    }))
}

#[cfg(test)]
mod tests {
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
                    });
                }
            }
            by_frame.push(numbers);
        }
        (sightings, by_frame, truth)
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

    /// Every way of matching two frames, for cases that can be listed.
    #[test]
    fn matches_of_two_frames_are_the_cheapest() {
        let places = [dvec2(0.0, 0.0), dvec2(1.0, 0.2), dvec2(3.0, -1.0)];
        let seen_then = [dvec2(1.2, 0.1), dvec2(2.6, -0.8), dvec2(0.1, 0.3)];
        let sighting = |place: &DVec2, seconds| Sighting {
            seconds,
            place: *place,
        };
        let sightings: Vec<Sighting> = seen_then.iter().map(|place| sighting(place, 1.0)).collect();
        let open: Vec<Chain> = places
            .iter()
            .map(|place| Chain {
                filter: Filter::new(&sighting(place, 0.0)).at(1.0),
                members: Vec::new(),
            })
            .collect();
        let found = matched(&open, &sightings, &[0, 1, 2]);
        let cost = |order: [usize; 3]| -> f64 {
            (0..3)
                .map(|row| open[row].filter.distance(seen_then[order[row]], 0.25).0)
                .sum()
        };
        let orders = [
            [0, 1, 2],
            [0, 2, 1],
            [1, 0, 2],
            [1, 2, 0],
            [2, 0, 1],
            [2, 1, 0],
        ];
        let best = orders
            .into_iter()
            .min_by(|a, b| cost(*a).total_cmp(&cost(*b)));
        assert_eq!(Some(found), best.map(|order| order.map(Some).to_vec()));
    }
}
