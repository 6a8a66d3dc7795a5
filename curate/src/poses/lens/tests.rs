use std::path::Path;

use serde::Deserialize;

use super::*;

fn lens(radial: [f64; 2], tangential: [f64; 2]) -> Lens {
    Lens {
        camera: PinholeCamera::new([320, 180], [260.0, 255.0], [158.0, 93.0]),
        distortion: opencv(radial, tangential),
    }
}

fn opencv([k1, k2]: [f64; 2], tangential: [f64; 2]) -> Distortion {
    Distortion {
        radial: [k1, k2, 0.0, 0.0, 0.0, 0.0],
        tangential,
        ..Distortion::default()
    }
}

const LENSES: [([f64; 2], [f64; 2]); 4] = [
    ([-0.12, 0.03], [0.0, 0.0]),
    ([0.09, 0.0], [0.0, 0.0]),
    ([-0.2, 0.05], [0.002, -0.003]),
    ([0.0, 0.0], [0.0, 0.0]),
];

#[test]
fn what_is_straightened_comes_back() {
    for (radial, tangential) in LENSES {
        let lens = lens(radial, tangential);
        let straight = lens.straight().expect("a straight camera");
        for pixel in border(&straight) {
            let source = lens.source(&straight, pixel);
            let back = lens.straightened(&straight, source);
            assert!(back.distance(pixel) < 1e-6, "{pixel} {back}");
            // Every pixel is one of the frame.
            assert!(source.min_element() >= -1e-9 && source.x <= 320.0 && source.y <= 180.0);
        }
    }
    assert!(lens([0.0; 2], [0.0; 2]).is_negligible());
    assert!(!lens([-0.12, 0.03], [0.0; 2]).is_negligible());
    // A lens that folds the image shows no whole one.
    assert_eq!(lens([-40.0, 0.0], [0.0; 2]).straight(), None);
}

/// A barrel bends lines outwards and shows more than a straight image of the same focal length.
#[test]
fn a_barrel_is_zoomed_out_to_its_corners_alone() {
    let barrel = lens([-0.12, 0.0], [0.0; 2]);
    let straight = barrel.straight().expect("a straight camera");
    assert!(straight.fx < barrel.camera.fx, "{straight:?}");
    let nearest = border(&straight)
        .map(|pixel| {
            let [x, y] = barrel.source(&straight, pixel).to_array();
            x.min(y).min(320.0 - x).min(180.0 - y)
        })
        .fold(f64::INFINITY, f64::min);
    assert!((0.0..1e-6).contains(&nearest), "{nearest}");
}

#[test]
fn half_the_size_is_the_same_lens() {
    let full = lens([-0.12, 0.03], [0.002, -0.003]);
    let half = full.resized(160, 90);
    let source = full.source(&full.camera, dvec2(300.0, 20.0));
    let of_half = half.source(&half.camera, dvec2(150.0, 10.0));
    assert!((0.5 * source).distance(of_half) < 1e-9);
}

#[test]
fn frames_and_masks_are_straightened_alike() {
    let lens = lens([-0.3, 0.0], [0.0; 2]);
    let straight = lens.straight().expect("a straight camera");
    let straightening = lens.straightening(&straight);
    // A disc about the principal point stays one, with another radius.
    let is_inside = |pixel: usize| {
        let centre = dvec2((pixel % 320) as f64 + 0.5, (pixel / 320) as f64 + 0.5);
        centre.distance(dvec2(158.0, 93.0)) < 60.0
    };
    let mask = Mask {
        width: 320,
        height: 180,
        data: (0..320 * 180)
            .map(|at| u8::from(is_inside(at)) * 255)
            .collect(),
    };
    let frame = RgbImage {
        width: 320,
        height: 180,
        data: mask
            .data
            .iter()
            .flat_map(|&value| [f32::from(value) / 255.0; 3])
            .collect(),
    };
    let (mask, frame) = (straightening.mask(&mask), straightening.image(&frame));
    let differing = mask
        .data
        .iter()
        .zip(frame.data.as_chunks::<3>().0)
        .filter(|(covered, colour)| (**covered > 0) != (colour[0] > 0.5))
        .count();
    assert!(differing < 120, "{differing}");
    let area = mask.data.iter().filter(|&&value| value > 0).count();
    let edge = lens.straightened(&straight, dvec2(218.0, 93.0)).x - 158.0;
    let expected = std::f64::consts::PI * edge * edge;
    assert!(
        (area as f64 / expected - 1.0).abs() < 0.04,
        "{area} {expected}"
    );
}

/// Output of `scripts/golden/lens.py` with OpenCV.
#[derive(Deserialize)]
struct Golden {
    width: u32,
    height: u32,
    intrinsics: [f64; 4],
    pixels: Vec<DVec2>,
    frame: Vec<f32>,
    lenses: Vec<GoldenLens>,
}

#[derive(Deserialize)]
struct GoldenLens {
    /// The terms k1, k2, p1, p2.
    terms: [f64; 4],
    distorted: Vec<DVec2>,
    straightened: Vec<DVec2>,
    image: Vec<f32>,
}

#[test]
fn places_and_frames_are_those_of_opencv() {
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/golden/lens.json");
    let golden = std::fs::read(file).expect("the golden file");
    let golden: Golden = serde_json::from_slice(&golden).expect("sound JSON");
    let [fx, fy, cx, cy] = golden.intrinsics;
    let camera = PinholeCamera::new([golden.width, golden.height], [fx, fy], [cx, cy]);
    let frame = RgbImage {
        width: golden.width as usize,
        height: golden.height as usize,
        data: golden.frame.iter().flat_map(|&grey| [grey; 3]).collect(),
    };
    for one in golden.lenses {
        let [k1, k2, p1, p2] = one.terms;
        let lens = Lens {
            camera,
            distortion: opencv([k1, k2], [p1, p2]),
        };
        for ((&pixel, distorted), straightened) in golden
            .pixels
            .iter()
            .zip(one.distorted)
            .zip(one.straightened)
        {
            let place = lens.source(&camera, pixel);
            assert!(place.distance(distorted) < 1e-9, "{place} {distorted}");
            let place = lens.straightened(&camera, pixel);
            assert!(
                place.distance(straightened) < 1e-9,
                "{place} {straightened}"
            );
        }
        let straight = lens.straightening(&camera).image(&frame);
        for (pixel, (ours, theirs)) in straight
            .data
            .as_chunks::<3>()
            .0
            .iter()
            .zip(one.image)
            .enumerate()
        {
            // OpenCV's weights are of 32nds of a pixel, and neighbours differ by a tenth.
            assert!(
                (ours[0] - theirs).abs() < 3e-3,
                "pixel {pixel}: {} {theirs}",
                ours[0]
            );
        }
    }
}

/// A model with COLMAP's pixels, by `scripts/golden/lens_models.py`.
#[derive(Deserialize)]
struct GoldenModel {
    model: String,
    number: i32,
    size: [u32; 2],
    parameters: Vec<f64>,
    /// Places at depth 1, and the pixels that show them.
    places: Vec<DVec2>,
    pixels: Vec<DVec2>,
}

#[test]
fn all_models_are_those_of_colmap() {
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/golden/lens_models.json");
    let golden = std::fs::read(file).expect("the golden file");
    let golden: Vec<GoldenModel> = serde_json::from_slice(&golden).expect("sound JSON");
    assert_eq!(golden.len(), 17);
    for one in golden {
        let model = LensModel::of_name(&one.model).expect("a model");
        let of_number = LensModel::of_number(one.number).expect("a model");
        assert_eq!(of_number.name, one.model);
        let lens = model
            .lens(one.size, &one.parameters)
            .expect("sound numbers");
        let depth_one = PinholeCamera {
            fx: 1.0,
            fy: 1.0,
            cx: 0.0,
            cy: 0.0,
            ..lens.camera
        };
        for (&place, &pixel) in one.places.iter().zip(&one.pixels) {
            let shown = lens.source(&depth_one, place);
            assert!(
                shown.distance(pixel) < 1e-9,
                "{}: {shown} {pixel}",
                one.model
            );
            let back = lens.straightened(&depth_one, pixel);
            assert!(back.distance(place) < 1e-8, "{}: {back} {place}", one.model);
        }
        let straight = lens.straight().expect("a straight camera");
        for pixel in border(&straight) {
            let source = lens.source(&straight, pixel);
            let back = lens.straightened(&straight, source);
            assert!(back.distance(pixel) < 1e-6, "{}: {pixel} {back}", one.model);
        }
        for wrong in 0..one.parameters.len() {
            let mut parameters = one.parameters.clone();
            parameters[wrong] = f64::NAN;
            assert_eq!(model.lens(one.size, &parameters), None);
        }
        assert_eq!(model.lens(one.size, &one.parameters[1..]), None);
    }
}

/// A wide lens keeps the resolution of its middle and loses its border.
#[test]
fn a_fisheye_is_cut_to_the_resolution_of_its_middle() {
    let fisheye = Lens {
        camera: PinholeCamera {
            width: 400,
            height: 400,
            fx: 400.0 / std::f64::consts::PI,
            fy: 400.0 / std::f64::consts::PI,
            cx: 200.0,
            cy: 200.0,
        },
        distortion: Distortion {
            projection: Projection::Equidistant,
            ..Distortion::default()
        },
    };
    let straight = fisheye.straight().expect("a straight camera");
    assert!((straight.fx / fisheye.camera.fx - 1.0).abs() < 1e-6);
    let across = Lens::angle_across_degrees(&straight);
    assert!((across - 115.0).abs() < 0.1, "{across}");
    assert!(!fisheye.is_negligible());
}
