//! Images that state more pixels than they hold.

use std::{fs, path::Path};

use image::{DynamicImage, ImageBuffer, Luma, LumaA, Rgba};
use omnilife_schemas::{RgbImage, image_file::ImageFile, rgb::Mask};

fn crc32(bytes: &[u8]) -> u32 {
    !bytes.iter().fold(u32::MAX, |crc, &byte| {
        (0..8).fold(crc ^ u32::from(byte), |crc, _| {
            (crc >> 1) ^ (0xedb8_8320 * (crc & 1))
        })
    })
}

/// Writes a grey PNG file that states a size and has almost no pixels.
fn write_stating(path: &Path, width: u32, height: u32) {
    let mut bytes = b"\x89PNG\r\n\x1a\n".to_vec();
    let header = [
        &width.to_be_bytes()[..],
        &height.to_be_bytes(),
        &[8, 0, 0, 0, 0],
    ]
    .concat();
    for (kind, data) in [(b"IHDR", header), (b"IDAT", vec![0; 32]), (b"IEND", vec![])] {
        bytes.extend((data.len() as u32).to_be_bytes());
        let body = [&kind[..], &data].concat();
        bytes.extend(&body);
        bytes.extend(crc32(&body).to_be_bytes());
    }
    fs::write(path, bytes).unwrap();
}

#[test]
fn sizes_are_looked_at_before_pixels() {
    let temp = tempfile::tempdir().unwrap();
    let path = temp.path().join("bomb.png");
    for (width, height) in [(23_000, 23_000), (u32::MAX >> 1, 1 << 20)] {
        write_stating(&path, width, height);
        for error in [
            RgbImage::read(&path).unwrap_err(),
            Mask::read(&path).unwrap_err(),
        ] {
            let message = error.to_string();
            assert!(
                message.contains("bomb.png") && !message.contains('\n'),
                "{message}"
            );
            assert!(
                message.contains(&format!("{width}x{height} pixels")) || width > 1 << 30,
                "{message}"
            );
        }
    }
    // The size is known without the pixels, which are damaged.
    write_stating(&path, 4096, 2048);
    let file = ImageFile::open(&path).unwrap();
    assert_eq!(file.size(), [4096, 2048]);
    let error = file.expect_size([64, 32]).map(drop).unwrap_err();
    assert!(
        error
            .to_string()
            .ends_with("is 4096x2048 pixels, expected 64x32"),
        "{error}"
    );
    let error = RgbImage::read(&path).unwrap_err().to_string();
    assert!(error.contains("not a usable image"), "{error}");
}

#[test]
fn depth_of_another_kind_is_refused_before_it_is_decoded() {
    let temp = tempfile::tempdir().unwrap();
    let path = temp.path().join("depth.png");
    write_stating(&path, 64, 32);
    let error = ImageFile::open(&path).unwrap().decode_grey16().unwrap_err();
    assert!(
        error.to_string().contains("expected 16-bit grey"),
        "{error}"
    );
}

/// Returns images of 4 x 2 pixels, one with opacity `alpha`, the others opaque.
fn with_alpha(alpha: u16) -> [DynamicImage; 4] {
    let at = |x: u32, y: u32| if (x, y) == (3, 1) { alpha } else { u16::MAX };
    let byte = |x: u32, y: u32| (at(x, y) >> 8) as u8;
    [
        ImageBuffer::from_fn(4, 2, |x, y| LumaA([90, byte(x, y)])).into(),
        ImageBuffer::from_fn(4, 2, |x, y| LumaA([90_u16 << 8, at(x, y)])).into(),
        ImageBuffer::from_fn(4, 2, |x, y| Rgba([90, 80, 70, byte(x, y)])).into(),
        ImageBuffer::from_fn(4, 2, |x, y| Rgba([90_u16 << 8, 0, 0, at(x, y)])).into(),
    ]
}

#[test]
fn what_is_transparent_anywhere_is_refused_and_shown_in_black() {
    let temp = tempfile::tempdir().unwrap();
    let path = temp.path().join("a.png");
    for (opaque, clear) in with_alpha(u16::MAX).iter().zip(with_alpha(0x8000)) {
        let kind = opaque.color();
        opaque.save(&path).unwrap();
        let shown = ImageFile::open(&path).unwrap().decode_shown().unwrap();
        assert_eq!(shown.transparent, None, "{kind:?}");
        assert_eq!(RgbImage::read(&path).unwrap().to_rgb8(), shown.rgb);
        assert_eq!(shown.rgb, opaque.to_rgb8().into_raw(), "{kind:?}");

        clear.save(&path).unwrap();
        let error = RgbImage::read(&path).unwrap_err().to_string();
        assert!(
            error.contains("a.png: ") && !error.contains('\n'),
            "{error}"
        );
        let shown = ImageFile::open(&path).unwrap().decode_shown().unwrap();
        let mask = shown.transparent.unwrap();
        assert_eq!(mask.data, [0, 0, 0, 0, 0, 0, 0, 255], "{kind:?}");
        let mut expected = opaque.to_rgb8().into_raw();
        expected[3 * 7..].fill(0);
        assert_eq!(shown.rgb, expected, "{kind:?}");
    }
}

/// Enters an orientation of EXIF, 1 to 8, into a PNG file, behind the header, which is 33 bytes long.
fn orient(path: &Path, orientation: u8) {
    const ENTRY: &[u8] = b"eXIfMM\0\x2a\0\0\0\x08\0\x01\x01\x12\0\x03\0\0\0\x01\0";
    let mut bytes = fs::read(path).unwrap();
    let body = [ENTRY, &[orientation, 0, 0, 0, 0, 0, 0]].concat();
    let mut chunk = (body.len() as u32 - 4).to_be_bytes().to_vec();
    chunk.extend(&body);
    chunk.extend(crc32(&body).to_be_bytes());
    bytes.splice(33..33, chunk);
    fs::write(path, bytes).unwrap();
}

#[test]
fn what_asks_to_be_turned_is_refused_and_shown_turned() {
    let temp = tempfile::tempdir().unwrap();
    let path = temp.path().join("a.png");
    let pixel = |column: usize, row: usize| [20 * column as u8, 90 * row as u8, 7];
    let pixels: Vec<u8> = (0..8).flat_map(|at| pixel(at % 4, at / 4)).collect();
    // The stored pixel that is shown in the upper left corner (EXIF 2.3, tag 274).
    for (orientation, [column, row], size) in [
        (1, [0, 0], [4, 2]),
        (2, [3, 0], [4, 2]),
        (3, [3, 1], [4, 2]),
        (4, [0, 1], [4, 2]),
        (5, [0, 0], [2, 4]),
        (6, [0, 1], [2, 4]),
        (7, [3, 1], [2, 4]),
        (8, [3, 0], [2, 4]),
    ] {
        RgbImage::from_rgb8(4, 2, &pixels).write_png(&path).unwrap();
        orient(&path, orientation);
        let is_plain = orientation == 1;
        assert_eq!(RgbImage::read(&path).is_ok(), is_plain, "{orientation}");
        assert_eq!(Mask::read(&path).is_ok(), is_plain, "{orientation}");
        let shown_size = ImageFile::open(&path).unwrap().shown_size().unwrap();
        let shown = ImageFile::open(&path).unwrap().decode_shown().unwrap();
        assert_eq!((shown_size, shown.size), (size, size), "{orientation}");
        assert_eq!(shown.rgb[..3], pixel(column, row), "{orientation}");
        assert_eq!(shown.is_turned, !is_plain);
        let stored = ImageFile::open(&path).unwrap().decode_stored().unwrap();
        assert_eq!((stored.size, &stored.rgb), ([4, 2], &pixels));
        assert_eq!(stored.is_turned, !is_plain);
    }
}

/// Greys of 8 and 16 bits are plain images.
#[test]
fn greys_are_plain() {
    let temp = tempfile::tempdir().unwrap();
    let path = temp.path().join("a.png");
    let deep: DynamicImage = ImageBuffer::from_fn(4, 2, |x, _| Luma([x as u16 * 257])).into();
    deep.save(&path).unwrap();
    let read = RgbImage::read(&path).unwrap();
    assert_eq!(read.to_rgb8()[..6], [0, 0, 0, 1, 1, 1]);
}

/// Decoders fill what is missing with grey; a thumbnail in the metadata ends as a whole image does.
#[test]
fn jpeg_files_that_end_within_their_image_are_refused() {
    let temp = tempfile::tempdir().unwrap();
    let path = temp.path().join("photograph.jpg");
    let noise = ImageBuffer::from_fn(96, 48, |x, y| {
        image::Rgb([
            (x * 37 % 251) as u8,
            (y * 91 % 239) as u8,
            (x * y % 256) as u8,
        ])
    });
    DynamicImage::ImageRgb8(noise).save(&path).unwrap();
    let plain = fs::read(&path).unwrap();
    // A comment in front of the image that holds a whole JPEG.
    let length = u16::try_from(plain.len() + 2).unwrap().to_be_bytes();
    let with_thumbnail = [&plain[..2], &[0xff, 0xfe], &length, &plain, &plain[2..]].concat();
    // Some cameras write further data behind the image.
    let with_more = [&plain[..], b"more"].concat();
    for whole in [&plain, &with_thumbnail, &with_more] {
        fs::write(&path, whole).unwrap();
        assert_eq!(RgbImage::read(&path).unwrap().width, 96);
    }
    for (whole, least) in [(&plain, 2), (&with_thumbnail, plain.len() + 6)] {
        let lengths = [3, whole.len() / 2, whole.len() * 9 / 10, whole.len() - 2];
        for length in lengths.into_iter().filter(|length| *length > least) {
            fs::write(&path, &whole[..length]).unwrap();
            let error = RgbImage::read(&path).map(drop).unwrap_err().to_string();
            assert!(error.contains("photograph.jpg"), "{length}: {error}");
            assert!(error.contains("not a usable image"), "{length}: {error}");
        }
    }
}
