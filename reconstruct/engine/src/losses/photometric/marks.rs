//! Pixels whose colours are unknown or only bounded.
//!
//! A saturated value is only a lower bound: a camera with gain `g` shows `min(g L, 1)`. Once the gain is
//! removed from the image, its target is `1 / g`, which may be darker or brighter than the scene and differs
//! from view to view. The render is therefore compared with the largest value that the camera could show. As
//! soon as the render is at least as bright, both images take the target there, and the gradient is 0. Black needs no
//! such care: it is 0 under every gain.

use super::rows::CHANNELS;

/// Marks of an image's ignored pixels and saturated values.
#[derive(Debug, Clone, Copy, Default)]
pub struct PixelMarks<'a> {
    /// Non-zero for pixels to ignore; `None` if all count.
    pub ignored: Option<&'a [u8]>,
    /// True for saturated values (HWC); empty to treat no value as saturated.
    pub saturated: &'a [bool],
}

impl PixelMarks<'_> {
    /// Returns true if no pixel or value is marked.
    pub(super) fn are_none(&self) -> bool {
        self.ignored.is_none() && self.saturated.is_empty()
    }

    /// Returns true if value `at` of a render has no gradient: ignored, or saturated and not darker than its
    /// target.
    pub(super) fn settle(&self, at: usize, render: f32, target: f32) -> bool {
        self.ignored
            .is_some_and(|ignored| ignored[at / CHANNELS] != 0)
            || render >= target && self.saturated.get(at) == Some(&true)
    }

    /// Writes the render with the target in place of values without gradient.
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

    /// Writes the weights of the pixels; empty if all count.
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

    /// Returns a ramp of light from darkness to twice white, from left to right.
    fn ramp() -> Vec<f32> {
        let [width, height] = SIZE;
        let level = |pixel: usize| 2.0 * (pixel % width) as f32 / width as f32;
        (0..width * height)
            .flat_map(|pixel| [level(pixel); 3])
            .collect()
    }

    /// Returns the ramp as shown by a camera of a gain, with the gain removed, and the marks of saturated
    /// values.
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
            // Without marks, the colours of saturated pixels pull the render down.
            let (_, as_it_is) = loss_of(&truth, &target, &[]);
            let (value, gradient) = loss_of(&truth, &target, &saturated);
            let pull = |gradient: &[f32]| -> f32 {
                let of_saturated = gradient.iter().zip(&saturated).filter(|(_, is)| **is);
                of_saturated.map(|(by, _)| by.abs()).sum()
            };
            assert_eq!(pull(&gradient), 0.0, "{gain}");
            assert_eq!(pull(&as_it_is) > 0.1, gain > 0.5, "{gain}");
            // The remaining error is the rounding to bytes.
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
            // In windows of constant level the variance is 0 up to rounding of its squares, about 1e-8,
            // against SSIM's constant of 9e-4.
            assert!(error < 5e-5 * largest, "{at}: {found} {expected}");
        }
    }
}
