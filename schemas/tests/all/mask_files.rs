//! Masks as programs write them: every kind of file gives the same marked pixels.

use std::{
    fs::File,
    io::BufWriter,
    path::{Path, PathBuf},
};

use image::{GrayImage, Luma};
use omnilife_schemas::{
    camera::{Camera, ErpCamera, PinholeCamera},
    image_file::ImageFile,
    mask_file::{self, DecodedMask, MarkedGreys, MaskEncoding},
    mask_survey::MaskSurvey,
    rgb::Mask,
    store::StoreError,
};
use png::{BitDepth, ColorType};
use proptest::prelude::*;
use tempfile::TempDir;

const SIZE: [u32; 2] = [16, 8];

/// Marks a disc.
fn is_marked(pixel: usize) -> bool {
    let (x, y) = (pixel as i32 % 16 - 6, pixel as i32 / 16 - 4);
    x * x + y * y < 9
}

/// Returns pixels of `size` values each.
fn pixels(marked: &[u8], other: &[u8]) -> Vec<u8> {
    let count = (SIZE[0] * SIZE[1]) as usize;
    (0..count)
        .flat_map(|pixel| if is_marked(pixel) { marked } else { other }.to_vec())
        .collect()
}

/// Packs values of `bits` bits.
fn packed(bits: usize, marked: u8, other: u8) -> Vec<u8> {
    let values = pixels(&[marked], &[other]);
    values
        .chunks(8 / bits)
        .map(|chunk| {
            let add = |byte: u8, value: &u8| (byte << bits) | value;
            chunk.iter().fold(0, add)
        })
        .collect()
}

fn write(
    path: &Path,
    colour: ColorType,
    depth: BitDepth,
    (palette, alphas): (&[u8], &[u8]),
    data: &[u8],
) {
    let mut encoder = png::Encoder::new(
        BufWriter::new(File::create(path).unwrap()),
        SIZE[0],
        SIZE[1],
    );
    encoder.set_color(colour);
    encoder.set_depth(depth);
    if colour == ColorType::Indexed {
        encoder.set_palette(palette.to_vec());
        if !alphas.is_empty() {
            encoder.set_trns(alphas.to_vec());
        }
    }
    let mut writer = encoder.write_header().unwrap();
    writer.write_image_data(data).unwrap();
}

struct Folder(TempDir);

impl Folder {
    fn new() -> Self {
        Self(tempfile::tempdir().unwrap())
    }

    fn write(&self, colour: ColorType, depth: BitDepth, data: &[u8]) -> PathBuf {
        self.write_with(colour, depth, (&[], &[]), data)
    }

    fn write_with(
        &self,
        colour: ColorType,
        depth: BitDepth,
        palette: (&[u8], &[u8]),
        data: &[u8],
    ) -> PathBuf {
        let path = self.0.path().join("mask.png");
        write(&path, colour, depth, palette, data);
        path
    }
}

fn decode(path: &Path) -> DecodedMask {
    mask_file::decode(ImageFile::open(path).unwrap(), MarkedGreys::AboveHalf).unwrap()
}

#[track_caller]
fn assert_marks_the_disc(path: &Path, encoding: MaskEncoding) {
    let decoded = decode(path);
    let marks: Vec<bool> = decoded.mask.data.iter().map(|&value| value != 0).collect();
    let expected: Vec<bool> = (0..marks.len()).map(is_marked).collect();
    assert_eq!(marks, expected);
    assert_eq!(decoded.encoding, encoding);
    // The common entry point is the same reader.
    assert_eq!(Mask::read(path).unwrap(), decoded.mask);
}

#[test]
fn white_on_black_is_marked_at_every_depth() {
    let folder = Folder::new();
    for (depth, bits) in [(BitDepth::One, 1), (BitDepth::Two, 2), (BitDepth::Four, 4)] {
        let data = packed(bits, (1 << bits) as u8 - 1, 0);
        let path = folder.write(ColorType::Grayscale, depth, &data);
        assert_marks_the_disc(&path, MaskEncoding::BlackAndWhite);
    }
    let path = folder.write(ColorType::Grayscale, BitDepth::Eight, &pixels(&[255], &[0]));
    assert_marks_the_disc(&path, MaskEncoding::BlackAndWhite);
    let path = folder.write(
        ColorType::Grayscale,
        BitDepth::Sixteen,
        &pixels(&[255, 255], &[0, 0]),
    );
    assert_marks_the_disc(&path, MaskEncoding::BlackAndWhite);
    let path = folder.write(ColorType::Rgb, BitDepth::Eight, &pixels(&[255; 3], &[0; 3]));
    assert_marks_the_disc(&path, MaskEncoding::BlackAndWhite);
}

/// Smoothed edges are marked from the middle on.
#[test]
fn soft_edges_are_cut_at_half() {
    let folder = Folder::new();
    let mut data = pixels(&[255], &[0]);
    (data[0], data[1]) = (127, 128);
    let path = folder.write(ColorType::Grayscale, BitDepth::Eight, &data);
    let decoded = decode(&path);
    assert_eq!(decoded.encoding, MaskEncoding::BlackAndWhite);
    assert_eq!(
        (decoded.mask.data[0] != 0, decoded.mask.data[1] != 0),
        (false, true)
    );
}

#[test]
fn small_numbers_are_labels() {
    let folder = Folder::new();
    for label in [1, 2, 6, 100] {
        let path = folder.write(
            ColorType::Grayscale,
            BitDepth::Eight,
            &pixels(&[label], &[0]),
        );
        assert_marks_the_disc(&path, MaskEncoding::Labels);
    }
    let path = folder.write(
        ColorType::Grayscale,
        BitDepth::Sixteen,
        &pixels(&[0, 3], &[0, 0]),
    );
    assert_marks_the_disc(&path, MaskEncoding::Labels);
    // A file without any marked pixel holds no label.
    let path = folder.write(ColorType::Grayscale, BitDepth::Eight, &pixels(&[0], &[0]));
    let decoded = decode(&path);
    assert_eq!(decoded.encoding, MaskEncoding::BlackAndWhite);
    assert!(decoded.mask.data.iter().all(|&value| value == 0));
}

/// Palettes of segmentation datasets: a dark entry is an object like any other.
#[test]
fn palettes_are_read_by_their_index() {
    let folder = Folder::new();
    let palette = [0, 0, 0, 128, 0, 0, 0, 64, 0, 20, 20, 60];
    for index in [1, 2, 3] {
        let data = pixels(&[index], &[0]);
        let path = folder.write_with(ColorType::Indexed, BitDepth::Eight, (&palette, &[]), &data);
        assert_marks_the_disc(&path, MaskEncoding::Palette);
        let path = folder.write_with(
            ColorType::Indexed,
            BitDepth::Two,
            (&palette, &[]),
            &packed(2, index, 0),
        );
        assert_marks_the_disc(&path, MaskEncoding::Palette);
    }
    // A transparent background agrees with the indices; a transparent object does not.
    let data = pixels(&[2], &[0]);
    let path = folder.write_with(ColorType::Indexed, BitDepth::Eight, (&palette, &[0]), &data);
    assert_marks_the_disc(&path, MaskEncoding::Palette);
    let path = folder.write_with(
        ColorType::Indexed,
        BitDepth::Eight,
        (&palette, &[255, 255, 0]),
        &data,
    );
    assert!(Mask::read(&path).is_err());
    // Black and white in a palette, in either order.
    for (palette, marked) in [([0, 0, 0, 255, 255, 255], 1), ([255, 255, 255, 0, 0, 0], 0)] {
        let data = pixels(&[marked], &[1 - marked]);
        let path = folder.write_with(ColorType::Indexed, BitDepth::Eight, (&palette, &[]), &data);
        assert_marks_the_disc(&path, MaskEncoding::BlackAndWhite);
    }
}

#[test]
fn colours_and_alpha_mark_too() {
    let folder = Folder::new();
    for colour in [[200, 0, 0], [0, 0, 90], [10, 120, 10]] {
        let path = folder.write(ColorType::Rgb, BitDepth::Eight, &pixels(&colour, &[0; 3]));
        assert_marks_the_disc(&path, MaskEncoding::Colours);
    }
    let path = folder.write(
        ColorType::Rgba,
        BitDepth::Eight,
        &pixels(&[9, 9, 9, 255], &[9, 9, 9, 0]),
    );
    assert_marks_the_disc(&path, MaskEncoding::Alpha);
    let path = folder.write(
        ColorType::GrayscaleAlpha,
        BitDepth::Eight,
        &pixels(&[0, 255], &[0, 0]),
    );
    assert_marks_the_disc(&path, MaskEncoding::Alpha);
    // Alpha that agrees with the colours, and alpha that contradicts them.
    let path = folder.write(
        ColorType::Rgba,
        BitDepth::Eight,
        &pixels(&[255; 4], &[0; 4]),
    );
    assert_marks_the_disc(&path, MaskEncoding::BlackAndWhite);
    let path = folder.write(
        ColorType::Rgba,
        BitDepth::Eight,
        &pixels(&[255, 255, 255, 0], &[0, 0, 0, 255]),
    );
    assert!(Mask::read(&path).is_err());
}

/// A JPEG file keeps white and black approximately, and no labels.
#[test]
fn jpeg_files_hold_no_labels() {
    let folder = Folder::new();
    let path = folder.0.path().join("mask.jpg");
    // Halves of whole blocks, which are kept exactly.
    let write = |value: u8| {
        let half = |x: u32, _: u32| Luma([if x < 8 { value } else { 0 }]);
        GrayImage::from_fn(SIZE[0], SIZE[1], half)
            .save(&path)
            .unwrap();
    };
    write(255);
    let decoded = decode(&path);
    assert_eq!(decoded.encoding, MaskEncoding::BlackAndWhite);
    let mut rows = decoded.mask.data.chunks(SIZE[0] as usize);
    assert!(rows.all(|row| row[..8] == [255; 8] && row[8..] == [0; 8]));
    for label in [8, 60, 112] {
        write(label);
        let error = Mask::read(&path).unwrap_err();
        assert!(matches!(error, StoreError::Malformed { .. }), "{error}");
    }
    write(0);
    assert!(!Mask::read(&path).unwrap().marks_anything());
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    #[test]
    fn any_label_marks_what_white_does(
        marks in prop::collection::vec(any::<bool>(), (SIZE[0] * SIZE[1]) as usize),
        label in 1_u8..=127,
    ) {
        let folder = Folder::new();
        let read = |value: u8| {
            let data: Vec<u8> = marks.iter().map(|&mark| value * u8::from(mark)).collect();
            decode(&folder.write(ColorType::Grayscale, BitDepth::Eight, &data)).mask
        };
        prop_assert_eq!(read(label), read(255));
    }
}

#[test]
fn where_to_look_is_all_but_black() {
    let folder = Folder::new();
    let path = folder.write(ColorType::Grayscale, BitDepth::Eight, &pixels(&[255], &[1]));
    let image = || ImageFile::open(&path).unwrap();
    let above_half = mask_file::decode(image(), MarkedGreys::AboveHalf).unwrap();
    let not_black = mask_file::decode(image(), MarkedGreys::NotBlack).unwrap();
    let count = |mask: &Mask| mask.data.iter().filter(|&&value| value != 0).count();
    assert_eq!(count(&not_black.mask), 128);
    assert_eq!(
        count(&above_half.mask),
        (0..128).filter(|&pixel| is_marked(pixel)).count()
    );
}

/// Assumptions, masks that mark nothing and inverted-looking masks give one line each, once.
#[test]
fn oddities_are_told() {
    let folder = Folder::new();
    let camera = Camera::Erp(ErpCamera::new(SIZE[0], SIZE[1]));
    let notes = |marked: u8, other: u8, is_ignored: bool| {
        let path = folder.write(
            ColorType::Grayscale,
            BitDepth::Eight,
            &pixels(&[marked], &[other]),
        );
        let mut survey = MaskSurvey::default();
        for _ in 0..3 {
            if is_ignored {
                survey.add_ignored(&path, &camera).unwrap();
            } else {
                survey.add(&path, &camera, MarkedGreys::AboveHalf).unwrap();
            }
        }
        survey.notes().len()
    };
    assert_eq!(notes(255, 0, false), 0);
    assert_eq!(notes(255, 0, true), 0);
    assert_eq!(notes(3, 0, false), 1);
    assert_eq!(
        notes(0, 255, false),
        0,
        "what moves may be most of an image"
    );
    assert_eq!(notes(0, 255, true), 1, "inverted");
    assert_eq!(notes(0, 0, true), 1, "marks nothing");
}

/// The image of a narrow camera in the frame of a wider one is a rectangle, and no inverted mask.
#[test]
fn frames_of_wider_cameras_do_not_look_inverted() {
    let folder = Folder::new();
    let pinhole = Camera::Pinhole(PinholeCamera {
        width: 10,
        height: 8,
        fx: 5.0,
        fy: 5.0,
        cx: 5.0,
        cy: 4.0,
    });
    let erp = Camera::Erp(ErpCamera::new(16, 8));
    let notes = |camera: &Camera, is_left: fn(usize, usize) -> bool| {
        let [width, height] = camera.size();
        let pixels = (0..width * height).map(|at| {
            if is_left(at % width, at / width) {
                0
            } else {
                255
            }
        });
        let path = folder.0.path().join("mask.png");
        let greys = GrayImage::from_vec(width as u32, height as u32, pixels.collect()).unwrap();
        greys.save(&path).unwrap();
        let mut survey = MaskSurvey::default();
        survey.add_ignored(&path, camera).unwrap();
        survey.notes().len()
    };
    let rectangle = |x: usize, y: usize| (3..7).contains(&x) && (2..6).contains(&y);
    assert_eq!(notes(&pinhole, rectangle), 0);
    assert_eq!(notes(&pinhole, |x, y| x + y < 5), 1, "no rectangle");
    assert_eq!(notes(&pinhole, |_, _| false), 1, "nothing is left");
    assert_eq!(notes(&erp, |_, y| y > 6), 1, "the nadir alone is left");
}
