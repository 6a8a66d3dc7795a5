//! Area averaging by [`RgbImage::resized_by_area`], which scores rest on, and by OpenCV: the largest difference of
//! their results, then the time of each.
//!
//! `cargo bench -p omnilife-curate --bench area_averaging`; criterion's element is a pixel of the result.

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use omnilife_schemas::RgbImage;
use opencv::{
    core::{Mat, MatTraitConst, MatTraitConstManual, Size},
    imgproc,
};

const WIDTH: usize = 2048;
const HEIGHT: usize = 1024;

fn by_opencv(image: &RgbImage, [width, height]: [usize; 2]) -> opencv::Result<Vec<f32>> {
    let pixels = Mat::from_slice(&image.data)?;
    let pixels = pixels.reshape(3, image.height as i32)?;
    let mut resized = Mat::default();
    let size = Size::new(width as i32, height as i32);
    imgproc::resize(&pixels, &mut resized, size, 0.0, 0.0, imgproc::INTER_AREA)?;
    Ok(resized.reshape(1, 0)?.data_typed::<f32>()?.to_vec())
}

fn area(criterion: &mut Criterion) {
    let noise = |at: usize| (at * 2_654_435_761 % 1000) as f32 / 1000.0;
    let image = RgbImage::new(WIDTH, HEIGHT, (0..3 * WIDTH * HEIGHT).map(noise).collect());
    let mut group = criterion.benchmark_group(format!("area averaging of {WIDTH}x{HEIGHT}"));
    for [width, height] in [[256, 128], [512, 256], [640, 320]] {
        let own = image.resized_by_area(width, height);
        let other = by_opencv(&image, [width, height]).expect("resized");
        let pairs = own.data.iter().zip(&other);
        let largest = pairs.fold(0.0, |largest: f32, (a, b)| largest.max((a - b).abs()));
        println!("{width}x{height}: the results differ by {largest:e} at most");
        group.throughput(Throughput::Elements((width * height) as u64));
        group.bench_function(format!("own to {width}x{height}"), |bencher| {
            bencher.iter(|| image.resized_by_area(width, height));
        });
        group.bench_function(format!("OpenCV to {width}x{height}"), |bencher| {
            bencher.iter(|| by_opencv(&image, [width, height]));
        });
    }
    group.finish();
}

criterion_group!(benches, area);
criterion_main!(benches);
