// The photometric loss and its gradient. Blurs are separable: rows, then columns.
//
// Images are HWC; the moments of pixels are stored by plane: `(moment * pixels + pixel) * 3 + channel`.

const RADIUS: i32 = 5;
const C1: f32 = 1e-4;
const C2: f32 = 9e-4;

struct LossSettings {
    width: u32,
    height: u32,
    // Weight of 1 - SSIM.
    lambda: f32,
    // Number of values of the pixels that count.
    counted: f32,
    // Weights of the window's taps, from the centre outwards.
    taps: array<vec4<f32>, 2>,
    // 1 if only the masked part of the image counts; elsewhere the target is black.
    masked: u32,
    // Weight of the whole loss.
    weight: f32,
    // 1 if the first column follows the last.
    wraps: u32,
    // 1 if gains are removed: a saturated value is then only a lower bound.
    bounds_saturated: u32,
}

@group(0) @binding(0) var<uniform> settings: LossSettings;
@group(0) @binding(1) var<storage, read> render: array<f32>;
// 8 bits per channel, red in the lowest byte, the mask in the highest; then a bit per pixel, set if it is
// ignored; then the level of every byte, channel by channel.
@group(0) @binding(2) var<storage, read> target_image: array<u32>;
@group(0) @binding(3) var<storage, read_write> rows: array<f32>;
@group(0) @binding(4) var<storage, read_write> derivatives: array<f32>;
// Sums of |x - y|, (x - y)^2 and SSIM, per workgroup.
@group(0) @binding(5) var<storage, read_write> partials: array<vec4<f32>>;
@group(0) @binding(4) var<storage, read_write> gradient: array<f32>;
@group(0) @binding(1) var<storage, read_write> by_moment: array<f32>;
@group(0) @binding(2) var<storage, read_write> by_moment_rows: array<f32>;
@group(0) @binding(1) var<storage, read> all_partials: array<vec4<f32>>;
@group(0) @binding(2) var<storage, read_write> value: array<vec4<f32>>;

var<workgroup> sums: array<vec4<f32>, WORKGROUP>;

fn pixel_count() -> u32 {
    return settings.width * settings.height;
}

fn tap(distance: i32) -> f32 {
    let index = u32(abs(distance));
    return settings.taps[index / 4u][index % 4u];
}

fn level(packed: u32, channel: u32) -> f32 {
    let marks = (pixel_count() + 31u) / 32u;
    let byte = (packed >> (8u * channel)) & 255u;
    return bitcast<f32>(target_image[pixel_count() + marks + 256u * channel + byte]);
}

fn target_at(pixel: u32) -> vec3<f32> {
    let packed = target_image[pixel];
    let rgb = vec3(level(packed, 0u), level(packed, 1u), level(packed, 2u));
    return rgb * select(1.0, unpack4x8unorm(packed).w, settings.masked == 1u);
}

fn is_ignored(pixel: u32) -> bool {
    return ((target_image[pixel_count() + pixel / 32u] >> (pixel % 32u)) & 1u) == 1u;
}

fn drawn_at(pixel: u32) -> vec3<f32> {
    return vec3(render[pixel * 3u], render[pixel * 3u + 1u], render[pixel * 3u + 2u]);
}

// Saturated values of an image whose gain is removed; with a mask, only where it is 1.
fn saturated_at(pixel: u32) -> vec3<bool> {
    let rgb_mask = unpack4x8unorm(target_image[pixel]);
    let is_whole = settings.masked == 0u || rgb_mask.w > 0.999;
    if settings.bounds_saturated == 0u || !is_whole {
        return vec3<bool>();
    }
    return rgb_mask.xyz > vec3(0.999);
}

// Render with the target's colour where a pixel is ignored, or saturated and the render is at least as bright. It is
// needed for the windows that reach over such pixels.
fn render_at(pixel: u32) -> vec3<f32> {
    if is_ignored(pixel) {
        return target_at(pixel);
    }
    let drawn = drawn_at(pixel);
    if settings.bounds_saturated == 0u {
        return drawn;
    }
    let bounded = select(drawn, target_at(pixel), drawn >= target_at(pixel));
    return select(drawn, bounded, saturated_at(pixel));
}

// Pixel `distance` columns to the right, or -1 outside of the image. In a panorama the first column follows
// the last.
fn beside(pixel: u32, distance: i32) -> i32 {
    let width = i32(settings.width);
    let row_start = i32(pixel / settings.width) * width;
    var column = i32(pixel) - row_start + distance;
    if column < 0 || column >= width {
        if settings.wraps == 0u {
            return -1;
        }
        // Images may be narrower than the window.
        column = ((column % width) + width) % width;
    }
    return row_start + column;
}

// Pixel `distance` rows below, or -1 outside of the image.
fn below(pixel: u32, distance: i32) -> i32 {
    let other = i32(pixel) + distance * i32(settings.width);
    return select(-1, other, other >= 0 && other < i32(pixel_count()));
}

fn read_rows(plane: u32, pixel: i32) -> vec3<f32> {
    let index = (plane * pixel_count() + u32(pixel)) * 3u;
    return vec3(rows[index], rows[index + 1u], rows[index + 2u]);
}

// Blurs x, y, x^2, y^2 and xy along rows.
@compute @workgroup_size(256)
fn blur_rows(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) thread: u32,
) {
    let pixel = workgroup_number(group, groups) * WORKGROUP + thread;
    if pixel >= pixel_count() {
        return;
    }
    var moments: array<vec3<f32>, 5>;
    for (var distance = -RADIUS; distance <= RADIUS; distance++) {
        let other = beside(pixel, distance);
        if other < 0 {
            continue;
        }
        let weight = tap(distance);
        let x = render_at(u32(other));
        let y = target_at(u32(other));
        moments[0] += weight * x;
        moments[1] += weight * y;
        moments[2] += weight * (x * x);
        moments[3] += weight * (y * y);
        moments[4] += weight * (x * y);
    }
    for (var plane = 0u; plane < 5u; plane++) {
        let index = (plane * pixel_count() + pixel) * 3u;
        rows[index] = moments[plane].x;
        rows[index + 1u] = moments[plane].y;
        rows[index + 2u] = moments[plane].z;
    }
}

// Blurs along columns, and computes SSIM and its derivatives by the three moments that depend on x.
@compute @workgroup_size(256)
fn structural_similarity(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) thread: u32,
) {
    let number = workgroup_number(group, groups);
    let pixel = number * WORKGROUP + thread;
    var sum = vec4<f32>();
    if pixel < pixel_count() {
        var moments: array<vec3<f32>, 5>;
        for (var distance = -RADIUS; distance <= RADIUS; distance++) {
            let other = below(pixel, distance);
            if other >= 0 {
                let weight = tap(distance);
                for (var plane = 0u; plane < 5u; plane++) {
                    moments[plane] += weight * read_rows(plane, other);
                }
            }
        }
        let mx = moments[0];
        let my = moments[1];
        let a1 = 2.0 * mx * my + C1;
        let a2 = 2.0 * (moments[4] - mx * my) + C2;
        let b1 = mx * mx + my * my + C1;
        let b2 = (moments[2] - mx * mx) + (moments[3] - my * my) + C2;
        let s = a1 * a2 / (b1 * b2);
        let by_square = -s / b2;
        let by_product = 2.0 * a1 / (b1 * b2);
        let by_mean = 2.0 * my * a2 / (b1 * b2) - 2.0 * mx * s / b1 - 2.0 * mx * by_square
            - my * by_product;
        let counts = select(1.0, 0.0, is_ignored(pixel));
        var by: array<vec3<f32>, 3>
            = array(counts * by_mean, counts * by_square, counts * by_product);
        for (var plane = 0u; plane < 3u; plane++) {
            let index = (plane * pixel_count() + pixel) * 3u;
            derivatives[index] = by[plane].x;
            derivatives[index + 1u] = by[plane].y;
            derivatives[index + 2u] = by[plane].z;
        }
        let difference = render_at(pixel) - target_at(pixel);
        let one = vec3(1.0);
        sum = vec4(dot(abs(difference), one), dot(difference, difference), counts * dot(s, one), 0.0);
    }
    sums[thread] = sum;
    workgroupBarrier();
    for (var half = WORKGROUP / 2u; half > 0u; half /= 2u) {
        if thread < half {
            sums[thread] += sums[thread + half];
        }
        workgroupBarrier();
    }
    if thread == 0u && number * WORKGROUP < pixel_count() {
        partials[number] = sums[0];
    }
}

// Blurs the derivatives along rows: the first half of the transposed blur.
@compute @workgroup_size(256)
fn blur_derivative_rows(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) thread: u32,
) {
    let pixel = workgroup_number(group, groups) * WORKGROUP + thread;
    if pixel >= pixel_count() {
        return;
    }
    for (var plane = 0u; plane < 3u; plane++) {
        var sum = vec3<f32>();
        for (var distance = -RADIUS; distance <= RADIUS; distance++) {
            let other = beside(pixel, distance);
            if other < 0 {
                continue;
            }
            let index = (plane * pixel_count() + u32(other)) * 3u;
            sum += tap(distance)
                * vec3(by_moment[index], by_moment[index + 1u], by_moment[index + 2u]);
        }
        let index = (plane * pixel_count() + pixel) * 3u;
        by_moment_rows[index] = sum.x;
        by_moment_rows[index + 1u] = sum.y;
        by_moment_rows[index + 2u] = sum.z;
    }
}

// Blurs the derivatives along columns and assembles the gradient.
@compute @workgroup_size(256)
fn image_gradient(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) thread: u32,
) {
    let pixel = workgroup_number(group, groups) * WORKGROUP + thread;
    if pixel >= pixel_count() {
        return;
    }
    var by: array<vec3<f32>, 3>;
    for (var distance = -RADIUS; distance <= RADIUS; distance++) {
        let other = below(pixel, distance);
        if other >= 0 {
            let weight = tap(distance);
            for (var plane = 0u; plane < 3u; plane++) {
                by[plane] += weight * read_rows(plane, other);
            }
        }
    }
    let x = render_at(pixel);
    let y = target_at(pixel);
    // Negative, because the loss contains 1 - SSIM.
    var total = settings.weight / settings.counted * ((1.0 - settings.lambda) * sign(x - y)
        - settings.lambda * (by[0] + 2.0 * x * by[1] + y * by[2]));
    if is_ignored(pixel) {
        total = vec3<f32>();
    } else if settings.bounds_saturated == 1u {
        let bounded = select(total, vec3<f32>(), drawn_at(pixel) >= y);
        total = select(total, bounded, saturated_at(pixel));
    }
    gradient[pixel * 3u] = total.x;
    gradient[pixel * 3u + 1u] = total.y;
    gradient[pixel * 3u + 2u] = total.z;
}

// Adds up the workgroups' sums, always in the same order: mean |x - y|, mean (x - y)^2, mean SSIM, and the
// weighted loss.
@compute @workgroup_size(256)
fn loss_value(@builtin(local_invocation_index) thread: u32) {
    let count = (pixel_count() + WORKGROUP - 1u) / WORKGROUP;
    var sum = vec4<f32>();
    for (var index = thread; index < count; index += WORKGROUP) {
        sum += all_partials[index];
    }
    sums[thread] = sum;
    workgroupBarrier();
    for (var half = WORKGROUP / 2u; half > 0u; half /= 2u) {
        if thread < half {
            sums[thread] += sums[thread + half];
        }
        workgroupBarrier();
    }
    if thread == 0u {
        // Without a pixel that counts the loss is 0.
        if settings.counted == 0.0 {
            value[0] = vec4<f32>();
            return;
        }
        let means = sums[0] / settings.counted;
        let total = (1.0 - settings.lambda) * means.x + settings.lambda * (1.0 - means.z);
        value[0] = vec4(means.xyz, settings.weight * total);
    }
}
