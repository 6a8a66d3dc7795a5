//! Makes small clips with FFmpeg's own MPEG-4 encoder, so that no program has to be installed.
#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]
#![expect(
    unreachable_pub,
    reason = "every test file includes this module as its own"
)]
#![allow(
    dead_code,
    clippy::allow_attributes,
    reason = "every test file uses another part of it"
)]

use std::{
    f64::consts::{PI, TAU},
    path::{Path, PathBuf},
};

use ffmpeg::{Dictionary, Packet, codec, encoder, format, format::Pixel, frame, software::scaling};
use ffmpeg_next as ffmpeg;

/// Timestamps of written clips are multiples of this many seconds.
pub const TICK_SECONDS: f64 = 1.0 / 60_000.0;

/// A clip to be written.
pub struct Clip {
    pub width: usize,
    pub height: usize,
    /// Timestamps in ticks.
    pub ticks: Vec<i64>,
    /// Puts the index before the frames, so that a cut-off file can be opened.
    pub index_first: bool,
}

impl Clip {
    /// A steady clip.
    pub fn steady(width: usize, height: usize, frames: usize, frames_per_second: i64) -> Self {
        Self {
            width,
            height,
            ticks: (0..frames as i64)
                .map(|i| i * 60_000 / frames_per_second)
                .collect(),
            index_first: false,
        }
    }

    /// Writes the clip; `paint` gives the colour in [0, 1] at (frame, x, y).
    pub fn write(&self, path: &Path, paint: impl Fn(usize, usize, usize) -> [f64; 3]) {
        ffmpeg::init().unwrap();
        let codec = encoder::find(codec::Id::MPEG4).unwrap();
        let mut output = format::output(path).unwrap();
        let needs_global_header = output
            .format()
            .flags()
            .contains(format::Flags::GLOBAL_HEADER);
        let mut encoder = codec::context::Context::new_with_codec(codec)
            .encoder()
            .video()
            .unwrap();
        encoder.set_width(self.width as u32);
        encoder.set_height(self.height as u32);
        encoder.set_format(Pixel::YUV420P);
        encoder.set_time_base((1, 60_000));
        encoder.set_bit_rate(20_000_000);
        if needs_global_header {
            encoder.set_flags(codec::Flags::GLOBAL_HEADER);
        }
        let mut encoder = encoder.open().unwrap();
        output.add_stream(codec).unwrap().set_parameters(&encoder);
        let mut options = Dictionary::new();
        if self.index_first {
            options.set("movflags", "faststart");
        }
        output.write_header_with(options).unwrap();
        let time_base = output.stream(0).unwrap().time_base();
        let mut scaler = scaling::Context::get(
            Pixel::RGB24,
            self.width as u32,
            self.height as u32,
            Pixel::YUV420P,
            self.width as u32,
            self.height as u32,
            scaling::Flags::BICUBIC,
        )
        .unwrap();
        let drain = |encoder: &mut encoder::Video, output: &mut format::context::Output| {
            let mut packet = Packet::empty();
            while encoder.receive_packet(&mut packet).is_ok() {
                packet.set_stream(0);
                // Without it the muxer ends the clip where its last frame begins.
                packet.set_duration(self.ticks[1] - self.ticks[0]);
                packet.rescale_ts((1, 60_000), time_base);
                packet.write_interleaved(output).unwrap();
            }
        };
        for (index, &ticks) in self.ticks.iter().enumerate() {
            let mut yuv = frame::Video::empty();
            scaler.run(&self.painted(index, &paint), &mut yuv).unwrap();
            yuv.set_pts(Some(ticks));
            encoder.send_frame(&yuv).unwrap();
            drain(&mut encoder, &mut output);
        }
        encoder.send_eof().unwrap();
        drain(&mut encoder, &mut output);
        output.write_trailer().unwrap();
    }

    fn painted(
        &self,
        index: usize,
        paint: impl Fn(usize, usize, usize) -> [f64; 3],
    ) -> frame::Video {
        let mut rgb = frame::Video::new(Pixel::RGB24, self.width as u32, self.height as u32);
        let stride = rgb.stride(0);
        let bytes = rgb.data_mut(0);
        for y in 0..self.height {
            for x in 0..self.width {
                let colour = paint(index, x, y).map(|v| (v.clamp(0.0, 1.0) * 255.0).round() as u8);
                bytes[y * stride + 3 * x..][..3].copy_from_slice(&colour);
            }
        }
        rgb
    }
}

/// Colour of a made-up world in a direction: brighter above, detailed, and of other colours and
/// other detail for every `world` from 0 to 9.
pub fn world_colour(world: usize, direction: [f64; 3]) -> [f64; 3] {
    let [x, y, z] = direction;
    let phase = world as f64 * 1.7;
    let (a, b) = (5.0 + (world * 3 % 7) as f64, 6.0 + (world * 5 % 8) as f64);
    let detail = (a * x + phase).sin() * (b * y - phase).cos() + (b * z + 2.0 * phase).sin() * 0.7;
    let shades = [
        (world * 7 % 5) as f64,
        (world * 3 % 5) as f64,
        (world % 5) as f64,
    ];
    shades.map(|shade| 0.35 + 0.07 * shade + 0.16 * detail - 0.15 * y)
}

/// Unit direction of an ERP pixel of a `width` x `height` image, turned by `yaw` radians.
pub fn erp_direction(x: usize, y: usize, width: usize, height: usize, yaw: f64) -> [f64; 3] {
    let longitude = ((x as f64 + 0.5) / width as f64 - 0.5) * TAU + yaw;
    let latitude = (0.5 - (y as f64 + 0.5) / height as f64) * PI;
    [
        latitude.cos() * longitude.sin(),
        -latitude.sin(),
        latitude.cos() * longitude.cos(),
    ]
}

/// Writes an ERP clip that shows one world after the other and yaws slowly; returns its path.
pub fn erp_clip(
    folder: &Path,
    name: &str,
    worlds: &[usize],
    frames_each: usize,
    fps: i64,
) -> PathBuf {
    let (width, height) = (256, 128);
    let path = folder.join(name);
    Clip::steady(width, height, worlds.len() * frames_each, fps).write(&path, |frame, x, y| {
        let yaw = 0.2 * frame as f64 / fps as f64;
        world_colour(
            worlds[frame / frames_each],
            erp_direction(x, y, width, height, yaw),
        )
    });
    path
}

/// A file of the shared data beside the checkout, or `None` with a printed reason.
pub fn shared_data(name: &str) -> Option<PathBuf> {
    let path = Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("../../shared/data")
        .join(name);
    if path.exists() {
        return Some(path);
    }
    omnilife_schemas::testing::skip(format_args!("{} is not there", path.display()));
    None
}
