//! Detection of other channel orders, encodings and ranges of values.

use omnilife_schemas::statistics::quantile;

use super::{
    encoding::Encoding,
    images::{Small, correlation, least, mean, psnr_db},
    kind::ChannelOrder,
    look::ViewFacts,
};

/// Least mean gain in dB for another order of the channels; every view must gain.
const CHANNELS_GAIN_DB: f64 = 1.0;
/// Least correlation of colours without their mean, and without grey, after the change, and its least gain: a tint of a
/// grey scene must not pass for an order of channels.
const CHANNELS_CORRELATION: f64 = 0.5;
const CHANNELS_CORRELATION_GAIN: f64 = 0.3;
/// Or the largest remaining share of the difference to a correlation of 1.
const CHANNELS_LEFT_OF_MISSING: f64 = 0.5;

/// Least mean gain in dB for another encoding, and the least gain of every view.
const ENCODING_GAIN_DB: f64 = 2.0;
const ENCODING_VIEW_GAIN_DB: f64 = 0.5;
/// Largest share of the distance between the distributions of values that an encoding may leave unexplained: other
/// exposures and contrasts leave more. No exposure turns dark into bright.
const UNEXPLAINED: f64 = 0.3;
const UNEXPLAINED_INVERTED: f64 = 0.6;
/// Limited and expanded ranges are similar to contrasts and offsets with other causes. So gain and offset (of values in
/// [0, 1]) of the distribution over the ground truth's must be those of the range. The ground truth must also have this
/// spread, from its 5th to its 95th per cent, to be conclusive.
const UNEXPLAINED_RANGE: f64 = 0.35;
const RANGE_GAIN: f64 = 0.04;
const RANGE_OFFSET: f64 = 5.0 / 255.0;
const LEAST_REACH: f64 = 80.0 / 255.0;
/// An encoding that leaves less than this, and is as far from right as [`FAR`] (of values in [0, 1]), needs no gain:
/// clipped values cannot be restored.
const HARDLY_UNEXPLAINED: f64 = 0.1;
const FAR: f64 = 0.04;
/// Least correlation with the ground truth in that encoding, on the mean over the views.
const ENCODING_CORRELATION: f64 = 0.5;
/// Points at which distributions are compared, from the first to the last per cent.
const QUANTILES: usize = 50;

/// Values in [0, 1] of a prediction and of its ground truth at equal steps of their order.
type Distributions = [Vec<[f64; 3]>; 2];

/// Returns the order of channels in which the views are much better, with the mean gain in dB.
pub(super) fn channels(views: &[ViewFacts]) -> Option<(ChannelOrder, f64)> {
    let best = ChannelOrder::ALL
        .into_iter()
        .map(|order| {
            let gains = views.iter().map(|view| {
                let small = &view.small;
                let image = reordered(&small.predicted, order);
                small.psnr_of(&image) - small.psnr_of(&small.predicted)
            });
            (order, gains.collect::<Vec<f64>>())
        })
        .max_by(|(_, a), (_, b)| sum(a).total_cmp(&sum(b)));
    let (order, gains) = best.filter(|(_, gains)| !gains.is_empty())?;
    let of =
        |likeness: &dyn Fn(&Small) -> f64| mean(views.iter().map(|view| likeness(&view.small)));
    let before = of(&|small: &Small| likeness_of_colours(small, &small.predicted));
    let after =
        of(&|small: &Small| likeness_of_colours(small, &reordered(&small.predicted, order)));
    let gain = mean(gains.iter().copied());
    let tells = gain >= CHANNELS_GAIN_DB
        && least(gains) > 0.0
        && after >= CHANNELS_CORRELATION
        && (after - before >= CHANNELS_CORRELATION_GAIN
            || 1.0 - after <= CHANNELS_LEFT_OF_MISSING * (1.0 - before));
    tells.then_some((order, gain))
}

fn sum(gains: &[f64]) -> f64 {
    gains.iter().sum()
}

/// Returns the image with its channels read in their stored order.
fn reordered(image: &[f32], order: ChannelOrder) -> Vec<f32> {
    let pixels = image.as_chunks::<3>().0.iter();
    pixels
        .flat_map(|pixel| order.places().map(|place| pixel[place]))
        .collect()
}

/// Returns the correlation of the image and the ground truth without their grey values and without the mean of every
/// channel.
fn likeness_of_colours(small: &Small, image: &[f32]) -> f64 {
    let [image, truth] = [image, small.truth.as_slice()].map(|image| {
        let colour = |pixel: [f64; 3]| {
            let grey = pixel.iter().sum::<f64>() / 3.0;
            pixel.map(|value| value - grey)
        };
        let mut colours: Vec<[f64; 3]> = small.counted_pixels(image).map(colour).collect();
        let means = [0, 1, 2].map(|channel| mean(colours.iter().map(|pixel| pixel[channel])));
        for (value, mean) in colours
            .iter_mut()
            .flat_map(|pixel| pixel.iter_mut().zip(means))
        {
            *value -= mean;
        }
        colours
    });
    correlation(
        image.as_flattened().iter().copied(),
        truth.as_flattened().iter().copied(),
    )
}

/// Returns the encoding of the views' values instead of sRGB in the full range, with the mean gain in dB of undoing it
/// (below 0 if it cannot be undone).
///
/// It is found by the distributions of values, which hardly depend on places: those of the views equal those of the
/// ground truth in that encoding.
pub(super) fn encoding(views: &[ViewFacts]) -> Option<(Encoding, f64)> {
    let distributions: Vec<Distributions> = views
        .iter()
        .map(|view| {
            let small = &view.small;
            [&small.predicted, &small.truth].map(|image| quantiles(small, image))
        })
        .collect();
    let before = mean((distributions.iter()).map(|[predicted, truth]| distance(predicted, truth)));
    let unexplained = |encoding: Encoding| {
        let of_views = distributions.iter().map(|[predicted, truth]| {
            let mut encoded: Vec<[f64; 3]> =
                truth.iter().map(|&pixel| encoding.encoded(pixel)).collect();
            if encoding == Encoding::Inverted {
                // The darkest become the brightest.
                encoded.reverse();
            }
            distance(predicted, &encoded)
        });
        mean(of_views) / before.max(1e-9)
    };
    let candidates = Encoding::ALL.map(|encoding| (encoding, unexplained(encoding)));
    let (encoding, left) = (candidates.into_iter()).min_by(|(_, a), (_, b)| a.total_cmp(b))?;
    let most = match encoding {
        Encoding::Inverted => UNEXPLAINED_INVERTED,
        Encoding::LimitedRange | Encoding::ExpandedTwice => UNEXPLAINED_RANGE,
        _ => UNEXPLAINED,
    };
    if views.is_empty() || left > most || !fits_range(encoding, &distributions) {
        return None;
    }
    let gains: Vec<f64> = views
        .iter()
        .map(|view| gain_db(&view.small, encoding))
        .collect();
    let gain = mean(gains.iter().copied());
    let alike = mean(views.iter().map(|view| {
        let small = &view.small;
        let truth = small.counted_pixels(&small.truth);
        correlation(
            small.counted_pixels(&small.predicted).flatten(),
            truth.flat_map(|pixel| encoding.encoded(pixel.map(|value| value / 255.0))),
        )
    }));
    let helps = gain >= ENCODING_GAIN_DB && least(gains) >= ENCODING_VIEW_GAIN_DB;
    let is_plain = left <= HARDLY_UNEXPLAINED && before >= FAR;
    (alike >= ENCODING_CORRELATION && (helps || is_plain)).then_some((encoding, gain))
}

/// Returns true if the encoding is not a range, or gain and offset of the distributions are those of the range.
fn fits_range(encoding: Encoding, distributions: &[Distributions]) -> bool {
    let Some((gain, offset)) = encoding.range() else {
        return true;
    };
    let of = |which: usize| {
        let values = distributions.iter().map(move |views| &views[which]);
        values.flat_map(|values| values.as_flattened()).copied()
    };
    let truth: Vec<f64> = of(1).collect();
    let reach = [0.95, 0.05].map(|share| quantile(&truth, share).unwrap_or(0.0));
    // Clipped values lie on no line.
    let pairs = of(0).zip(of(1));
    let uncut: Vec<(f64, f64)> = pairs
        .filter(|(value, _)| (0.02..0.98).contains(value))
        .collect();
    let [predicted, truth] = [
        mean(uncut.iter().map(|pair| pair.0)),
        mean(uncut.iter().map(|pair| pair.1)),
    ];
    let products = uncut
        .iter()
        .map(|pair| (pair.0 - predicted) * (pair.1 - truth));
    let squares = uncut.iter().map(|pair| (pair.1 - truth).powi(2));
    let found_gain = products.sum::<f64>() / squares.sum::<f64>().max(1e-9);
    let found_offset = predicted - found_gain * truth;
    reach[0] - reach[1] >= LEAST_REACH
        && (found_gain - gain).abs() <= RANGE_GAIN
        && (found_offset - offset).abs() <= RANGE_OFFSET
}

/// Returns the gain in dB of undoing an encoding.
fn gain_db(small: &Small, encoding: Encoding) -> f64 {
    let truth = small.counted_pixels(&small.truth);
    let decoded = small.counted_pixels(&small.predicted).map(|pixel| {
        (encoding.decoded(pixel.map(|value| value / 255.0))).map(|value| 255.0 * value)
    });
    let squares = truth.zip(decoded).map(|(truth, decoded)| {
        mean([0, 1, 2].map(|channel| (truth[channel] - decoded[channel]).powi(2)))
    });
    psnr_db(mean(squares)) - small.psnr_of(&small.predicted)
}

/// Values in [0, 1] of every channel at equal steps of their order.
fn quantiles(small: &Small, image: &[f32]) -> Vec<[f64; 3]> {
    let sorted = [0, 1, 2].map(|channel| {
        let pixels = small.counted_pixels(image);
        let mut values: Vec<f64> = pixels.map(|pixel| pixel[channel] / 255.0).collect();
        values.sort_by(f64::total_cmp);
        values
    });
    let at = |index: usize| {
        let share = 0.01 + 0.98 * index as f64 / (QUANTILES - 1) as f64;
        sorted.each_ref().map(|values| {
            let rank = (share * values.len().saturating_sub(1) as f64).round() as usize;
            values.get(rank).copied().unwrap_or(0.0)
        })
    };
    (0..QUANTILES).map(at).collect()
}

/// Returns the mean distance of two distributions.
fn distance(a: &[[f64; 3]], b: &[[f64; 3]]) -> f64 {
    let values = a.as_flattened().iter().zip(b.as_flattened());
    mean(values.map(|(a, b)| (a - b).abs()))
}
