//! Pixels of an image that say less than their colours.
//!
//! A saturated value says that its level is at least that, and how much above is lost: a camera with gain `g` shows
//! `min(g L, 1)`. Where the gain is taken out of the image, the target of such a value is `1 / g`, darker or brighter
//! than the scene is, another one in each view. The render is held to what the camera could show: in both images
//! stands the target as soon as the render is no darker, and there is no gradient. Black needs no such care: 0 is 0
//! under every gain.

use super::rows::CHANNELS;

/// Marks of an image: which of its pixels and values say less than their colours.
#[derive(Debug, Clone, Copy, Default)]
pub struct PixelMarks<'a> {
    /// Marks (not zero) the pixels that show nothing of the scene; `None` where there are none.
    pub ignored: Option<&'a [u8]>,
    /// Marks the values, RGB after RGB, that are saturated; empty where those are taken as they are.
    pub saturated: &'a [bool],
}

impl PixelMarks<'_> {
    /// Returns whether every value says all.
    pub(super) fn are_none(&self) -> bool {
        self.ignored.is_none() && self.saturated.is_empty()
    }

    /// Returns whether the value number `at` of a render has no say against its target.
    pub(super) fn settle(&self, at: usize, render: f32, target: f32) -> bool {
        self.ignored
            .is_some_and(|ignored| ignored[at / CHANNELS] != 0)
            || render >= target && self.saturated.get(at) == Some(&true)
    }

    /// Writes the render with the target where it has no say.
    pub(super) fn composite(&self, render: &[f32], target: &[f32], out: &mut Vec<f32>) {
        out.clear();
        let values = render.iter().zip(target).enumerate();
        out.extend(values.map(|(at, (&render, &target))| {
            if self.settle(at, render, target) {
                target
            } else {
                render
            }
        }));
    }

    /// Writes the weights of the pixels; none where all count alike.
    pub(super) fn weigh(&self, out: &mut Vec<f32>) {
        out.clear();
        let marks = self.ignored.into_iter().flatten();
        out.extend(marks.map(|&mark| if mark == 0 { 1.0 } else { 0.0 }));
    }
}

#[cfg(test)]
mod tests {
    use crate::losses::photometric::{
        Columns, LossValue, PixelMarks, cpu::Loss, reference::ReferencePair,
    };

    const SIZE: [usize; 2] = [48, 12];
    const LAMBDA: f32 = 0.2;

    /// A ramp of light from darkness to twice white, from left to right.
    fn ramp() -> Vec<f32> {
        let [width, height] = SIZE;
        let level = |pixel: usize| 2.0 * (pixel % width) as f32 / width as f32;
        (0..width * height)
            .flat_map(|pixel| [level(pixel); 3])
            .collect()
    }

    /// Returns the ramp as a camera of a gain shows it, the gain taken out, and the marks of saturated values.
    fn shown(gain: f32) -> (Vec<f32>, Vec<bool>) {
        let bytes = ramp().into_iter().map(|level| {
            let byte = (255.0 * gain * level).round().min(255.0);
            (byte / 255.0 / gain, byte >= 255.0)
        });
        bytes.unzip()
    }

    fn loss_of(render: &[f32], target: &[f32], saturated: &[bool]) -> (LossValue, Vec<f32>) {
        let marks = PixelMarks {
            ignored: None,
            saturated,
        };
        let mut loss = Loss::new(SIZE[0], SIZE[1], Columns::End);
        let (value, gradient) = loss.forward_backward_marked(marks, render, target, LAMBDA);
        (value, gradient.to_vec())
    }

    #[test]
    fn a_clipped_ramp_pulls_at_no_colours_that_are_right() {
        let truth = ramp();
        for gain in [0.5, 1.5, 2.0] {
            let (target, saturated) = shown(gain);
            let count = saturated.iter().filter(|&&is| is).count();
            assert_eq!(count > 0, gain > 0.5);
            // Taken as they are, the colours of saturated pixels pull the render down.
            let (_, as_it_is) = loss_of(&truth, &target, &[]);
            let (value, gradient) = loss_of(&truth, &target, &saturated);
            let pull = |gradient: &[f32]| -> f32 {
                let of_saturated = gradient.iter().zip(&saturated).filter(|(_, is)| **is);
                of_saturated.map(|(by, _)| by.abs()).sum()
            };
            assert_eq!(pull(&gradient), 0.0, "{gain}");
            assert_eq!(pull(&as_it_is) > 0.1, gain > 0.5, "{gain}");
            // What is left is the rounding to bytes.
            assert!(
                value.l1 < 0.5 / 255.0 / f64::from(gain),
                "{gain}: {value:?}"
            );
        }
    }

    #[test]
    fn what_is_too_dark_for_a_saturated_pixel_is_pulled_up() {
        let (target, saturated) = shown(2.0);
        let dark: Vec<f32> = ramp().iter().map(|level| 0.1 * level).collect();
        let (value, gradient) = loss_of(&dark, &target, &saturated);
        let (expected, as_it_is) = loss_of(&dark, &target, &[]);
        assert_eq!((value, gradient), (expected, as_it_is));
    }

    #[test]
    fn the_gradient_is_that_of_the_reference_with_the_target_where_the_render_is_brighter() {
        let [width, height] = SIZE;
        let (target, saturated) = shown(2.0);
        let render: Vec<f32> = ramp()
            .iter()
            .enumerate()
            .map(|(at, level)| level + 0.3 * (at as f32).sin())
            .collect();
        let is_settled = |at: usize| saturated[at] && render[at] >= target[at];
        let widen =
            |values: &[f32]| -> Vec<f64> { values.iter().copied().map(f64::from).collect() };
        let mut composited = widen(&render);
        for (at, value) in composited.iter_mut().enumerate() {
            if is_settled(at) {
                *value = f64::from(target[at]);
            }
        }
        let pair = ReferencePair {
            width,
            height,
            columns: Columns::End,
            render: &composited,
            target: &widen(&target),
            mask: &vec![1.0; width * height],
        };
        let (expected, by_render) = pair.value_and_gradient(f64::from(LAMBDA));
        let (value, gradient) = loss_of(&render, &target, &saturated);
        assert!(
            (value.total - expected.total).abs() < 1e-6,
            "{value:?} {expected:?}"
        );
        let largest = by_render
            .iter()
            .fold(0.0_f64, |most, by| most.max(by.abs()));
        for (at, (&found, expected)) in gradient.iter().zip(by_render).enumerate() {
            let expected = if is_settled(at) { 0.0 } else { expected };
            let error = (f64::from(found) - expected).abs();
            // In windows of one level a variance is 0 to the rounding of its squares, some 1e-8, beside SSIM's constant
            // of 9e-4.
            assert!(error < 5e-5 * largest, "{at}: {found} {expected}");
        }
    }
}
