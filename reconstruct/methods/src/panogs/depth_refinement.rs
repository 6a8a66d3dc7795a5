//! Joint bilateral upsampling of inverse distances (Kopf et al. 2007): distances with fewer pixels than the image
//! get its grid, along its edges.

use omnilife_engine::training_view::TrainingView;
use omnilife_schemas::distances::{DistanceImage, EDGE_RATIO};
use rayon::prelude::*;

use omnilife_training::{scene::depth::resized_view, seeds::depth::SourceView};

/// Pixels of the coarse grid on each side that take part.
const REACH: i64 = 2;
/// Standard deviation of the weight over places, coarse pixels.
const SPREAD_PIXELS: f32 = 0.8;
/// Standard deviation of the weight over colours, of a channel in [0, 255].
const SPREAD_COLOUR: f32 = 12.0;

/// Returns a view on its image's own grid.
///
/// Among the coarse pixels around an image's pixel, the likeliest by position and colour selects the surface. The
/// distances of the same surface are averaged; no distance between two surfaces is made.
pub(super) fn refined(image: &TrainingView, coarse: &SourceView) -> SourceView {
    let camera = &image.view.camera;
    let size = camera.size();
    let [width, height] = size;
    let small = resized_view(image, [coarse.distances.width, coarse.distances.height]);
    let mut values = vec![0.0; width * height];
    let mut confidences = coarse
        .confidences
        .as_ref()
        .map(|_| vec![0.0; width * height]);
    let upsampler = Upsampler {
        image,
        small: &small,
        distances: &coarse.distances,
    };
    let taken: Vec<Option<(f32, usize)>> = (0..width * height)
        .into_par_iter()
        .map(|pixel| upsampler.at([pixel % width, pixel / width], size))
        .collect();
    for (pixel, taken) in taken.into_iter().enumerate() {
        if let Some((distance, nearest)) = taken {
            values[pixel] = distance;
            if let (Some(to), Some(from)) = (&mut confidences, &coarse.confidences) {
                to[pixel] = from[nearest];
            }
        }
    }
    SourceView {
        view: image.clone(),
        distances: DistanceImage {
            width,
            height,
            wraps: coarse.distances.wraps,
            values,
        },
        confidences,
    }
}

struct Upsampler<'a> {
    image: &'a TrainingView,
    small: &'a TrainingView,
    distances: &'a DistanceImage,
}

impl Upsampler<'_> {
    /// Returns the distance of a pixel of the image, and the coarse pixel that it is most like.
    fn at(&self, [column, row]: [usize; 2], size: [usize; 2]) -> Option<(f32, usize)> {
        let (width, height) = (self.distances.width as i64, self.distances.height as i64);
        let u = (column as f32 + 0.5) * width as f32 / size[0] as f32 - 0.5;
        let v = (row as f32 + 0.5) * height as f32 / size[1] as f32 - 0.5;
        let (middle, top) = (u.round() as i64, v.round() as i64);
        let own = 3 * (row * size[0] + column);
        let colour = &self.image.pixels[own..own + 3];
        let mut near: [(f32, f32, usize); 25] = [(0.0, 0.0, 0); 25];
        let mut count = 0;
        for y in (top - REACH).max(0)..=(top + REACH).min(height - 1) {
            for x in middle - REACH..=middle + REACH {
                let column = if self.distances.wraps {
                    x.rem_euclid(width)
                } else if (0..width).contains(&x) {
                    x
                } else {
                    continue;
                };
                let pixel = (y * width + column) as usize;
                let distance = self.distances.values[pixel];
                if distance <= 0.0 {
                    continue;
                }
                let away = (x as f32 - u).powi(2) + (y as f32 - v).powi(2);
                let theirs = &self.small.pixels[3 * pixel..3 * pixel + 3];
                let squares = colour.iter().zip(theirs).map(|(&a, &b)| {
                    let difference = f32::from(a) - f32::from(b);
                    difference * difference
                });
                let unlike = squares.sum::<f32>() / 3.0;
                let exponent = away / (2.0 * SPREAD_PIXELS * SPREAD_PIXELS)
                    + unlike / (2.0 * SPREAD_COLOUR * SPREAD_COLOUR);
                near[count] = ((-exponent).exp().max(1e-30), distance, pixel);
                count += 1;
            }
        }
        let near = &near[..count];
        let &(_, likeliest, pixel) = near.iter().max_by(|a, b| a.0.total_cmp(&b.0))?;
        let of_surface = near.iter().filter(|(_, distance, _)| {
            distance.max(likeliest) < EDGE_RATIO * distance.min(likeliest)
        });
        let (sum, inverse) = of_surface
            .fold((0.0, 0.0), |(sum, inverse), (weight, distance, _)| {
                (sum + weight, inverse + weight / distance)
            });
        Some((sum / inverse, pixel))
    }
}
