//! Region of what is carried, from the evidence of single pixels.
//!
//! Evidence lies on outlines: skin, cloth and plastic inside of them look alike. What carries the camera stands below it,
//! so that the region goes from the upper outline down.

use omnilife_schemas::{camera::ErpCamera, rgb::Mask};

use super::super::{field::Field, vote};
use crate::opencv_images::grown;

/// Content above this latitude does not carry the camera, degrees.
const TOP_DEGREES: f64 = -15.0;
/// Columns with an outline below this latitude alone are not filled, degrees.
const LOWEST_TOP_DEGREES: f64 = -65.0;
/// The region ends here, degrees: a stand is narrow, and the floor below it shows. Set on one clip.
const BOTTOM_DEGREES: f64 = -78.0;
/// Pixels of evidence that are so far apart belong together.
const NEAR_PIXELS: usize = 1;
/// Regions with a smaller share of the evidence of the best one are left out.
const LEAST_SHARE: f64 = 0.3;
/// Gaps and spikes up to twice as wide are smoothed away, pixels.
const SMOOTHING_PIXELS: usize = 3;

#[derive(Debug, Clone)]
pub(super) struct Region {
    /// Its pixels, at the size of the evidence.
    pub(super) mask: Mask,
    /// Evidence of its strongest part: grey levels of 255 times steradians.
    pub(super) evidence: f64,
}

/// Finds the region of what is carried; `None` without any evidence.
pub(super) fn find(stays: &Field) -> opencv::Result<Option<Region>> {
    let (width, height) = (stays.width, stays.height);
    let camera = ErpCamera::new(width as u32, height as u32);
    let row_at = |degrees: f64| ((0.5 - degrees / 180.0) * height as f64) as usize;
    let is_seed = |pixel: usize| stays.values[pixel] > 0.0 && pixel / width >= row_at(TOP_DEGREES);
    let seeds: Vec<u8> = (0..stays.values.len())
        .map(|pixel| 255 * u8::from(is_seed(pixel)))
        .collect();
    let near: Vec<bool> = grown(&seeds, width, NEAR_PIXELS)?
        .iter()
        .map(|&value| value != 0)
        .collect();
    let evidence = |region: &[usize]| -> f64 {
        let seeds = region.iter().filter(|&&pixel| is_seed(pixel));
        let weighted = seeds.map(|&pixel| {
            let row = (pixel / width) as u32;
            255.0 * f64::from(stays.values[pixel]) * camera.pixel_solid_angle(row)
        });
        weighted.sum()
    };
    let regions = vote::regions(&near, width, true);
    let regions: Vec<(f64, Vec<usize>)> = regions
        .into_iter()
        .map(|region| (evidence(&region), region))
        .collect();
    let most = regions.iter().map(|(found, _)| *found).fold(0.0, f64::max);
    if most == 0.0 {
        return Ok(None);
    }
    let mut data = vec![0; width * height];
    for (_, region) in regions
        .iter()
        .filter(|(found, _)| *found >= LEAST_SHARE * most)
    {
        let mut tops = vec![height; width];
        for &pixel in region.iter().filter(|&&pixel| is_seed(pixel)) {
            let top = &mut tops[pixel % width];
            *top = (*top).min(pixel / width);
        }
        for (column, top) in tops.into_iter().enumerate() {
            if top < row_at(LOWEST_TOP_DEGREES) {
                for row in top..row_at(BOTTOM_DEGREES) {
                    data[row * width + column] = 255;
                }
            }
        }
    }
    Ok(Some(Region {
        mask: Mask::new(width, height, smoothed(&data, width)?),
        evidence: most,
    }))
}

/// Closes gaps, then removes spikes.
fn smoothed(marks: &[u8], width: usize) -> opencv::Result<Vec<u8>> {
    let inverted = |marks: Vec<u8>| -> Vec<u8> { marks.into_iter().map(|value| !value).collect() };
    let shrunk = |marks: Vec<u8>| -> opencv::Result<Vec<u8>> {
        Ok(inverted(grown(&inverted(marks), width, SMOOTHING_PIXELS)?))
    };
    let closed = shrunk(grown(marks, width, SMOOTHING_PIXELS)?)?;
    grown(&shrunk(closed)?, width, SMOOTHING_PIXELS)
}

#[cfg(test)]
mod tests {
    use super::*;

    const WIDTH: usize = 128;
    const HEIGHT: usize = 64;

    /// Evidence on the upper outline of a body across the seam, and a weak spot elsewhere.
    fn evidence(above: f32, spot: f32) -> Field {
        let mut values = vec![0.0; WIDTH * HEIGHT];
        for column in (0..12).chain(WIDTH - 12..WIDTH) {
            values[40 * WIDTH + column] = 0.2;
            values[10 * WIDTH + column] = above;
        }
        values[45 * WIDTH + 60] = spot;
        Field {
            width: WIDTH,
            height: HEIGHT,
            values,
        }
    }

    #[test]
    fn a_body_goes_from_its_upper_outline_down() {
        let region = find(&evidence(0.0, 0.01))
            .expect("filtered")
            .expect("a region");
        let at = |column: usize, row: usize| region.mask.data[row * WIDTH + column];
        assert!(region.evidence > 0.0);
        assert_eq!([at(0, 50), at(WIDTH - 1, 50), at(10, 41)], [255; 3]);
        assert_eq!(
            [at(0, 38), at(30, 50), at(60, 50), at(0, HEIGHT - 1)],
            [0; 4]
        );
    }

    #[test]
    fn the_sky_carries_no_camera() {
        let mut above = evidence(0.5, 0.0);
        for value in &mut above.values[40 * WIDTH..] {
            *value = 0.0;
        }
        assert!(find(&above).expect("filtered").is_none());
    }
}
