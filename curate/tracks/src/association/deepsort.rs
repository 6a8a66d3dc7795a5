//! `deepsort`: association of boxes in the image from frame to frame, by motion and appearance (Wojke, Bewley and
//! Paulus, "Simple Online and Realtime Tracking with a Deep Association Metric", 2017), with the constants of PyPI
//! `deep-sort-realtime` 1.3.2.
//!
//! A Kalman filter predicts the centre, aspect ratio and height of every box. Confirmed chains take boxes inside their
//! gate first, the most recently seen ones before others; the rest is matched by overlap. The cost of a box is the
//! paper's Eq. 5 with `lambda` = 0, the least cosine distance of embeddings. Without appearance it is that with
//! `lambda` = 1, the squared Mahalanobis distance.

use omnilife_schemas::assignment::assign;

/// Standard deviations of a place and of a velocity, over the height of the box.
const PLACE: f64 = 1.0 / 20.0;
const VELOCITY: f64 = 1.0 / 160.0;
/// Absolute standard deviation of the aspect ratio, of the state and of a measurement.
const ASPECT: f64 = 1e-2;
const ASPECT_VELOCITY: f64 = 1e-5;
const ASPECT_MEASURED: f64 = 1e-1;
/// Largest squared Mahalanobis distance: 95 % of a chi-squared variable of 4 degrees.
const GATE: f64 = 9.4877;
/// Largest cosine distance of embeddings.
const LARGEST_COSINE: f64 = 0.2;
/// Largest share of two boxes outside of their overlap.
const LARGEST_REST: f64 = 0.7;
/// Frames without a box after which a chain ends.
const MOST_AGE: usize = 30;
/// Boxes that confirm a chain.
const CONFIRMED: usize = 3;

/// Groups boxes by object; `frames` holds, in order of time, the numbers of the boxes of each frame. Every group is in
/// order of time and comes from a confirmed chain.
///
/// `appearance` has an embedding per box.
pub fn associate(
    boxes: &[[f64; 4]],
    frames: &[Vec<usize>],
    appearance: Option<&[Vec<f32>]>,
) -> Vec<Vec<usize>> {
    let appearance = appearance.map(|all| all.iter().map(|one| unit(one)).collect());
    let mut tracker = Tracker {
        boxes,
        appearance,
        chains: Vec::new(),
    };
    for seen in frames {
        tracker.advance(seen);
    }
    let chains = tracker.chains.into_iter();
    chains
        .filter(Chain::is_confirmed)
        .map(|chain| chain.members)
        .collect()
}

/// Normalizes an embedding to length 1; to zeros if it has no information.
fn unit(embedding: &[f32]) -> Vec<f64> {
    let length = embedding
        .iter()
        .map(|&value| f64::from(value).powi(2))
        .sum::<f64>()
        .sqrt();
    let scale = if length > 0.0 { 1.0 / length } else { 0.0 };
    embedding
        .iter()
        .map(|&value| scale * f64::from(value))
        .collect()
}

/// A measured number, its velocity per frame, and their variances.
#[derive(Debug, Clone, Copy)]
struct Coordinate {
    value: f64,
    velocity: f64,
    of_value: f64,
    of_velocity: f64,
    mixed: f64,
}

/// Centre across and down, aspect ratio, height: each is filtered by itself, because their errors are independent.
#[derive(Debug, Clone, Copy)]
struct Filter([Coordinate; 4]);

/// Returns the measured numbers of a box.
fn measured([left, top, width, height]: [f64; 4]) -> [f64; 4] {
    [
        left + 0.5 * width,
        top + 0.5 * height,
        width / height,
        height,
    ]
}

/// Returns standard deviations of the four numbers at a height of the box: `aspect` for the third.
fn deviations(height: f64, share: f64, aspect: f64) -> [f64; 4] {
    [share * height, share * height, aspect, share * height]
}

impl Filter {
    fn new(sides: [f64; 4]) -> Self {
        let values = measured(sides);
        let of_values = deviations(values[3], 2.0 * PLACE, ASPECT);
        let of_velocities = deviations(values[3], 10.0 * VELOCITY, ASPECT_VELOCITY);
        Self(std::array::from_fn(|axis| Coordinate {
            value: values[axis],
            velocity: 0.0,
            of_value: of_values[axis].powi(2),
            of_velocity: of_velocities[axis].powi(2),
            mixed: 0.0,
        }))
    }

    fn advance(&mut self) {
        let height = self.0[3].value;
        let of_values = deviations(height, PLACE, ASPECT);
        let of_velocities = deviations(height, VELOCITY, ASPECT_VELOCITY);
        for (axis, one) in self.0.iter_mut().enumerate() {
            one.value += one.velocity;
            one.of_value += 2.0 * one.mixed + one.of_velocity + of_values[axis].powi(2);
            one.mixed += one.of_velocity;
            one.of_velocity += of_velocities[axis].powi(2);
        }
    }

    /// Returns variances of the four measured numbers.
    fn variances(&self) -> [f64; 4] {
        let noise = deviations(self.0[3].value, PLACE, ASPECT_MEASURED);
        std::array::from_fn(|axis| self.0[axis].of_value + noise[axis].powi(2))
    }

    /// Returns the squared Mahalanobis distance of a box.
    fn distance(&self, sides: [f64; 4]) -> f64 {
        let (values, variances) = (measured(sides), self.variances());
        (0..4)
            .map(|axis| (values[axis] - self.0[axis].value).powi(2) / variances[axis])
            .sum()
    }

    fn take_in(&mut self, sides: [f64; 4]) {
        let (values, variances) = (measured(sides), self.variances());
        for (axis, one) in self.0.iter_mut().enumerate() {
            let gain = [one.of_value, one.mixed].map(|of| of / variances[axis]);
            let difference = values[axis] - one.value;
            one.value += gain[0] * difference;
            one.velocity += gain[1] * difference;
            one.of_velocity -= gain[1] * one.mixed;
            one.of_value -= gain[0] * one.of_value;
            one.mixed -= gain[0] * one.mixed;
        }
    }

    /// Returns left, top, width and height.
    fn sides(&self) -> [f64; 4] {
        let [x, y, aspect, height] = self.0.map(|one| one.value);
        let width = aspect * height;
        [x - 0.5 * width, y - 0.5 * height, width, height]
    }
}

/// The boxes of an object so far.
#[derive(Debug)]
struct Chain {
    filter: Filter,
    members: Vec<usize>,
    /// Frames since the last of them.
    age: usize,
    is_over: bool,
}

impl Chain {
    fn is_confirmed(&self) -> bool {
        self.members.len() >= CONFIRMED
    }
}

struct Tracker<'a> {
    boxes: &'a [[f64; 4]],
    /// Embeddings of length 1.
    appearance: Option<Vec<Vec<f64>>>,
    chains: Vec<Chain>,
}

impl Tracker<'_> {
    fn advance(&mut self, seen: &[usize]) {
        for chain in self.chains.iter_mut().filter(|chain| !chain.is_over) {
            chain.filter.advance();
            chain.age += 1;
        }
        let mut left = seen.to_vec();
        let mut matches = Vec::new();
        let open = |tracker: &Self, is_wanted: &dyn Fn(&Chain) -> bool| -> Vec<usize> {
            (0..tracker.chains.len())
                .filter(|&at| !tracker.chains[at].is_over && is_wanted(&tracker.chains[at]))
                .collect()
        };
        for age in 1..=MOST_AGE {
            let of_age = open(self, &|chain| chain.is_confirmed() && chain.age == age);
            let limit = if self.appearance.is_some() {
                LARGEST_COSINE
            } else {
                GATE
            };
            let cost = |chain: usize, number: usize| self.cost(chain, number);
            matches.extend(least(&of_age, &mut left, limit, cost));
        }
        let is_matched =
            |at: usize, matches: &[(usize, usize)]| matches.iter().any(|&(chain, _)| chain == at);
        // Unconfirmed chains first, as the package lists them; this decides ties.
        let mut by_overlap = open(self, &|chain| !chain.is_confirmed());
        let recent = open(self, &|chain| chain.is_confirmed() && chain.age == 1);
        by_overlap.extend(recent.into_iter().filter(|&at| !is_matched(at, &matches)));
        let rest = |chain: usize, number: usize| {
            1.0 - overlap(self.chains[chain].filter.sides(), self.boxes[number])
        };
        matches.extend(least(&by_overlap, &mut left, LARGEST_REST, rest));
        for (at, chain) in self.chains.iter_mut().enumerate() {
            if chain.is_over {
                continue;
            }
            if let Some(&(_, number)) = matches.iter().find(|(chain, _)| *chain == at) {
                chain.filter.take_in(self.boxes[number]);
                chain.members.push(number);
                chain.age = 0;
            } else {
                chain.is_over = !chain.is_confirmed() || chain.age > MOST_AGE;
            }
        }
        self.chains.extend(left.into_iter().map(|number| Chain {
            filter: Filter::new(self.boxes[number]),
            members: vec![number],
            age: 0,
            is_over: false,
        }));
    }

    /// Returns the cost of a box for a chain; infinite outside of its gate.
    fn cost(&self, chain: usize, number: usize) -> f64 {
        let chain = &self.chains[chain];
        let squared = chain.filter.distance(self.boxes[number]);
        if squared > GATE {
            return f64::INFINITY;
        }
        let Some(appearance) = &self.appearance else {
            return squared;
        };
        let alike = chain.members.iter().map(|&member| {
            let pair = appearance[member].iter().zip(&appearance[number]);
            1.0 - pair.map(|(a, b)| a * b).sum::<f64>()
        });
        alike.fold(f64::INFINITY, f64::min)
    }
}

/// Returns the intersection over union.
fn overlap(a: [f64; 4], b: [f64; 4]) -> f64 {
    let side = |axis: usize| {
        let from = a[axis].max(b[axis]);
        let to = (a[axis] + a[axis + 2]).min(b[axis] + b[axis + 2]);
        (to - from).max(0.0)
    };
    let common = side(0) * side(1);
    common / (a[2] * a[3] + b[2] * b[3] - common)
}

/// Returns the pairs of chains and boxes with the least total cost, none above `limit`, and removes their boxes from
/// the unmatched ones.
fn least(
    chains: &[usize],
    left: &mut Vec<usize>,
    limit: f64,
    cost: impl Fn(usize, usize) -> f64,
) -> Vec<(usize, usize)> {
    // Costs above the limit are clamped.
    let costs: Vec<Vec<f64>> = chains
        .iter()
        .map(|&chain| {
            let costs = left.iter().map(|&number| cost(chain, number));
            costs
                .map(|cost| if cost > limit { limit + 1e-5 } else { cost })
                .collect()
        })
        .collect();
    let assigned = assign(&costs, left.len());
    let pairs: Vec<(usize, usize)> = assigned
        .into_iter()
        .enumerate()
        .filter_map(|(row, column)| Some((row, column?)))
        .filter(|&(row, column)| costs[row][column] <= limit)
        .map(|(row, column)| (chains[row], left[column]))
        .collect();
    left.retain(|number| pairs.iter().all(|(_, taken)| taken != number));
    pairs
}
