//! Detection of views that show other frames than their names state, and of copies of given views.

use std::{
    collections::{BTreeMap, BTreeSet},
    fmt,
};

use super::{
    copies::Truths,
    images::{mean, psnr_db},
    look::ViewFacts,
};

/// Least gain in dB by another frame, and the least share of the views that must gain.
const TELLING_GAIN_DB: f64 = 1.0;
const TELLING_SHARE: f64 = 0.75;
/// Largest loss of any view by another frame, dB.
const LARGEST_LOSS_DB: f64 = 0.5;
/// Least gain if the other frame may be a given one: renderings from given views resemble them. Blends resemble the
/// frames on both sides, so that the opposite side must not fit better than the right one.
const NEIGHBOUR_GAIN_DB: f64 = 3.0;
/// Least share of views of other frames if these are unordered.
const PERMUTED_SHARE: f64 = 0.5;
/// Least PSNR to an input view of its copy, and the least distance of the right one, dB.
const COPY_DB: f64 = 42.0;
const COPY_LEAD_DB: f64 = 3.0;

/// Frames that views show instead of their own.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum FrameOrder {
    /// The frame of the view so many places later in the list of the split.
    PlacesOn(i32),
    /// The frame so many later in the scene.
    FramesOn(i32),
    /// The views in reverse order.
    Reversed,
    /// The frames of other views, unordered.
    Permuted,
}

impl fmt::Display for FrameOrder {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let after = |steps: i32| if steps > 0 { "after" } else { "before" };
        match *self {
            Self::PlacesOn(steps) => {
                let side = after(steps);
                write!(
                    f,
                    "every view shows the one {side} it in the split's list; render the frame that its \
                     name says"
                )
            }
            Self::FramesOn(steps) => {
                let side = after(steps);
                write!(
                    f,
                    "every view is more like the frame {side} its own; count frames from 0 (views that \
                     are made of that frame alone look the same)"
                )
            }
            Self::Reversed => f.write_str(
                "views are in reverse order; render the frame that the name of a file says",
            ),
            Self::Permuted => f.write_str(
                "views show each other's frames, in no order; render the frame that the name of a file \
                 says (sort numbers as numbers)",
            ),
        }
    }
}

/// Returns the frames that may be shown instead of a view's own: its neighbours in `list` and in the scene, and its
/// counterpart from the end of `list`.
pub(super) fn frames_to_compare(frame: u32, list: &[u32]) -> BTreeSet<u32> {
    let shown = |order: FrameOrder| shown_instead(order, frame, list);
    ORDERS.into_iter().filter_map(shown).collect()
}

/// Orders that follow from the number of a frame.
const ORDERS: [FrameOrder; 5] = [
    FrameOrder::PlacesOn(-1),
    FrameOrder::PlacesOn(1),
    FrameOrder::Reversed,
    FrameOrder::FramesOn(-1),
    FrameOrder::FramesOn(1),
];

/// Returns the frame that the view of `frame` shows in an order.
fn shown_instead(order: FrameOrder, frame: u32, list: &[u32]) -> Option<u32> {
    let place = list.iter().position(|&other| other == frame)?;
    match order {
        FrameOrder::PlacesOn(steps) => list.get(place.checked_add_signed(steps as isize)?).copied(),
        FrameOrder::FramesOn(steps) => frame.checked_add_signed(steps),
        FrameOrder::Reversed => list.get(list.len() - 1 - place).copied(),
        FrameOrder::Permuted => None,
    }
}

/// Views beside the ground truths that they are compared with.
pub(super) struct Comparison<'a> {
    views: &'a [ViewFacts],
    /// Frames of the kind of views, in the order of the split.
    list: &'a [u32],
    /// PSNR of every view against every truth, dB.
    psnr_db: Vec<BTreeMap<u32, f64>>,
}

impl<'a> Comparison<'a> {
    /// Compares views of the frames of `list`; `truths` may lack some frames.
    pub(super) fn new(views: &'a [ViewFacts], list: &'a [u32], truths: &Truths) -> Self {
        let of_view = |view: &ViewFacts| {
            let image = &view.medium.predicted;
            let psnr = |truth: &[f32]| psnr_db(view.medium.error_between(image, truth));
            let others = truths
                .iter()
                .map(|(&frame, truth)| (frame, psnr(&truth.medium)));
            let mut by_frame: BTreeMap<u32, f64> = others.collect();
            by_frame.insert(view.view.frame, psnr(&view.medium.truth));
            by_frame
        };
        Self {
            views,
            list,
            psnr_db: views.iter().map(of_view).collect(),
        }
    }

    /// Counts views that are copies of a given frame and not of their own.
    pub(super) fn copies(&self, given: &[u32]) -> usize {
        let is_copy = |(view, by_frame): &(&ViewFacts, &BTreeMap<u32, f64>)| {
            let own = by_frame[&view.view.frame];
            let mut of_given = given.iter().filter_map(|frame| by_frame.get(frame));
            of_given.any(|&psnr| psnr >= COPY_DB && psnr >= own + COPY_LEAD_DB)
        };
        self.views.iter().zip(&self.psnr_db).filter(is_copy).count()
    }

    /// Returns the order in which the views fit much better, with the mean gain in dB.
    pub(super) fn order(&self) -> Option<(FrameOrder, f64)> {
        let by_number = ORDERS.into_iter().find_map(|order| {
            let gain = self.telling_gain(order)?;
            Some((order, gain))
        });
        by_number.or_else(|| self.permutation())
    }

    /// Returns gains in dB of the views whose frame in an order is another, examined one.
    fn gains(&self, order: FrameOrder) -> Vec<f64> {
        let gain = |(view, by_frame): (&ViewFacts, &BTreeMap<u32, f64>)| {
            let frame = view.view.frame;
            let shown = shown_instead(order, frame, self.list).filter(|&shown| shown != frame)?;
            Some(by_frame.get(&shown)? - by_frame[&frame])
        };
        self.views
            .iter()
            .zip(&self.psnr_db)
            .filter_map(gain)
            .collect()
    }

    fn telling_gain(&self, order: FrameOrder) -> Option<f64> {
        let gains = self.gains(order);
        let least = match order {
            FrameOrder::FramesOn(steps) => {
                let opposite = self.gains(FrameOrder::FramesOn(-steps));
                if opposite.iter().any(|&gain| gain >= 0.0) {
                    return None;
                }
                NEIGHBOUR_GAIN_DB
            }
            _ => TELLING_GAIN_DB,
        };
        let telling = gains.iter().filter(|&&gain| gain >= least).count();
        let tells = gains.len() >= 2
            && 2 * gains.len() >= self.views.len()
            && telling as f64 >= TELLING_SHARE * gains.len() as f64
            && gains.iter().all(|&gain| gain >= -LARGEST_LOSS_DB);
        tells.then(|| mean(gains))
    }

    /// Returns a permutation of views: the best frame of most is another view's, and hardly two share one.
    fn permutation(&self) -> Option<(FrameOrder, f64)> {
        let best = |(view, by_frame): (&ViewFacts, &BTreeMap<u32, f64>)| {
            let (&shown, psnr) = by_frame.iter().max_by(|a, b| a.1.total_cmp(b.1))?;
            Some((view.view.frame, shown, psnr - by_frame[&view.view.frame]))
        };
        let views = self.views.iter().zip(&self.psnr_db);
        let found: Vec<(u32, u32, f64)> = views.filter_map(best).collect();
        let is_other = |&&(own, shown, gain): &&(u32, u32, f64)| {
            shown != own && gain >= TELLING_GAIN_DB && self.list.contains(&shown)
        };
        let others = found.iter().filter(is_other).count();
        let distinct: BTreeSet<u32> = found.iter().map(|&(_, shown, _)| shown).collect();
        let count = found.len() as f64;
        let tells = found.len() >= 3
            && others as f64 >= PERMUTED_SHARE * count
            && distinct.len() as f64 >= TELLING_SHARE * count;
        tells.then(|| {
            (
                FrameOrder::Permuted,
                mean(found.iter().map(|found| found.2)),
            )
        })
    }
}
