// Projection of activated Gaussians to footprints in the image. One thread per Gaussian; a splat has the
// index of its Gaussian, and a Gaussian that is not drawn has the key CULLED.

const SH_C0: f32 = 0.2820948;

@group(0) @binding(1) var<storage, read> gaussians: array<Gaussian>;
@group(0) @binding(2) var<storage, read> harmonics: array<f32>;
@group(0) @binding(3) var<storage, read> features: array<f32>;
@group(0) @binding(4) var<storage, read_write> splats: array<Splat>;
// Colour, then features.
@group(0) @binding(5) var<storage, read_write> channels: array<f32>;
// Distances as sort keys, with the splats' indices.
@group(0) @binding(6) var<storage, read_write> keys: array<u32>;
@group(0) @binding(7) var<storage, read_write> numbers: array<u32>;

@group(0) @binding(3) var<storage, read> drawn_channels: array<f32>;
// SUMS per splat: 0, DRAWN_ELLIPSE or DRAWN_CONE, by the shape (10), by the logarithm of the opacity, by the
// centre's image (2, written here), by the channels.
@group(0) @binding(4) var<storage, read_write> splat_gradients: array<f32>;
@group(0) @binding(5) var<storage, read_write> gaussian_gradients: array<Gaussian>;
@group(0) @binding(6) var<storage, read_write> harmonic_gradients: array<f32>;
@group(0) @binding(7) var<storage, read_write> feature_gradients: array<f32>;

fn all_finite(gaussian: Gaussian) -> bool {
    // A sum is finite only if all of its terms are.
    let sum = gaussian.position + gaussian.scale + gaussian.rotation.xyz;
    return is_finite(sum.x) && is_finite(sum.y) && is_finite(sum.z)
        && is_finite(gaussian.rotation.w) && is_finite(gaussian.opacity);
}

// Columns of R S, from a unit quaternion (w, x, y, z) and scales.
fn axes(rotation: vec4<f32>, scale: vec3<f32>) -> mat3x3<f32> {
    let w = rotation.x;
    let x = rotation.y;
    let y = rotation.z;
    let z = rotation.w;
    return mat3x3(
        vec3(1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y + w * z), 2.0 * (x * z - w * y)) * scale.x,
        vec3(2.0 * (x * y - w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z + w * x)) * scale.y,
        vec3(2.0 * (x * z + w * y), 2.0 * (y * z - w * x), 1.0 - 2.0 * (x * x + y * y)) * scale.z,
    );
}

// A Gaussian in the camera frame.
struct Placed {
    is_seen: bool,
    // Centre in the camera frame.
    point: vec3<f32>,
    // Length of the point.
    distance: f32,
    // M = R S in world coordinates.
    axes: mat3x3<f32>,
}

fn place(gaussian: Gaussian) -> Placed {
    let point = to_camera(gaussian.position - view.centre);
    let distance = length(point);
    let largest = max(max(gaussian.scale.x, gaussian.scale.y), gaussian.scale.z);
    let is_seen = all_finite(gaussian) && is_finite(distance) && sees(point, distance)
        && (largest < distance || view.footprint == FOOTPRINT_RAY);
    return Placed(is_seen, point, distance, axes(gaussian.rotation, gaussian.scale));
}

// True if a Gaussian is drawn as a cone because of its position; its width is another reason.
fn is_cone(placed: Placed) -> bool {
    return view.footprint == FOOTPRINT_RAY
        || (view.camera == ERP && length(placed.point.xz) < CONE_RHO * placed.distance);
}

fn is_too_wide(linear: Linearization) -> bool {
    return view.camera == ERP && sqrt(linear.covariance.x) > CONE_WIDTH * f32(view.width);
}

// Coefficient number `coefficient` of a Gaussian.
fn harmonic(gaussian: u32, coefficient: u32) -> vec3<f32> {
    let index = (gaussian * sh_count(view.stored_sh_degree) + coefficient) * 3u;
    return vec3(harmonics[index], harmonics[index + 1u], harmonics[index + 2u]);
}

fn colour(gaussian: u32, direction: vec3<f32>) -> vec3<f32> {
    let values = basis(view.sh_degree, direction);
    var sum = 0.5 + SH_C0 * harmonic(gaussian, 0u);
    for (var k = 1u; k < sh_count(view.sh_degree); k++) {
        sum += values[k - 1u] * harmonic(gaussian, k);
    }
    // A NaN colour becomes black.
    return vec3(positive(sum.x), positive(sum.y), positive(sum.z));
}

fn positive(value: f32) -> f32 {
    return select(0.0, value, is_finite(value) && value > 0.0);
}

fn footprint(placed: Placed, gaussian: Gaussian) -> Splat {
    let q_max = largest_q(gaussian.opacity);
    if !is_cone(placed) {
        let linear = linearize(placed);
        if !is_too_wide(linear) {
            return Splat(
                linear.pixel,
                sqrt(q_max * linear.covariance.xz),
                ellipse(linear),
                gaussian.opacity,
                vec3(linear.determinant / linear.covariance.z, 0.0, 0.0),
                0.0,
                vec3<f32>(),
                ELLIPSE,
            );
        }
    }
    let cone = conic(placed, gaussian.scale);
    let bounds = cone_bounds(cone, q_max);
    return Splat(
        bounds.centre,
        bounds.extent,
        across_1(cone),
        gaussian.opacity,
        across_2(cone),
        cone.depth_variance,
        along(cone),
        CONE,
    );
}

@compute @workgroup_size(256)
fn project_gaussians(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) thread: u32,
) {
    let index = workgroup_number(group, groups) * WORKGROUP + thread;
    if index >= view.gaussians {
        return;
    }
    numbers[index] = index;
    keys[index] = CULLED;
    let gaussian = gaussians[index];
    let placed = place(gaussian);
    if !placed.is_seen || gaussian.opacity < ALPHA_MIN {
        return;
    }
    let splat = footprint(placed, gaussian);
    let sum = splat.first + splat.second + splat.third;
    let top = splat.centre.y - splat.extent.y;
    let bottom = splat.centre.y + splat.extent.y;
    if !is_finite(sum.x) || !is_finite(sum.y) || !is_finite(sum.z)
        || !is_finite(splat.depth_variance) || !is_finite(splat.extent.x)
        || !is_finite(top) || bottom < 0.5 || top > f32(view.height) - 0.5 {
        return;
    }
    splats[index] = splat;
    let seen_colour = colour(index, to_world(placed.point / placed.distance));
    channels[index * CHANNELS] = seen_colour.x;
    channels[index * CHANNELS + 1u] = seen_colour.y;
    channels[index * CHANNELS + 2u] = seen_colour.z;
    for (var feature = 0u; feature < CHANNELS - 3u; feature++) {
        channels[index * CHANNELS + 3u + feature] = features[index * (CHANNELS - 3u) + feature];
    }
    keys[index] = bitcast<u32>(placed.distance);
}

// VJP of `axes`: gradients by the scales and by the unit quaternion.
struct AxesGradient {
    scale: vec3<f32>,
    rotation: vec4<f32>,
}

fn axes_vjp(rotation: vec4<f32>, scale: vec3<f32>, d_axes: mat3x3<f32>) -> AxesGradient {
    let w = rotation.x;
    let x = rotation.y;
    let y = rotation.z;
    let z = rotation.w;
    let unscaled = axes(rotation, vec3(1.0));
    let c0 = d_axes[0] * scale.x;
    let c1 = d_axes[1] * scale.y;
    let c2 = d_axes[2] * scale.z;
    return AxesGradient(
        vec3(dot(d_axes[0], unscaled[0]), dot(d_axes[1], unscaled[1]), dot(d_axes[2], unscaled[2])),
        2.0 * vec4(
            z * (c0.y - c1.x) + y * (c2.x - c0.z) + x * (c1.z - c2.y),
            y * (c0.y + c1.x) + z * (c0.z + c2.x) + w * (c1.z - c2.y) - 2.0 * x * (c1.y + c2.z),
            x * (c0.y + c1.x) + z * (c1.z + c2.y) + w * (c2.x - c0.z) - 2.0 * y * (c0.x + c2.z),
            x * (c0.z + c2.x) + y * (c1.z + c2.y) + w * (c0.y - c1.x) - 2.0 * z * (c0.x + c1.y),
        ),
    );
}

// Gradient by a Gaussian that is drawn.
struct DrawnGradient {
    gaussian: Gaussian,
    // By the colour; the clamp of the colour at 0 stops it.
    colour: vec3<f32>,
    // Derivatives of the colour by the harmonics, the constant one left out.
    basis: array<f32, 15>,
}

// Returns the gradient by a Gaussian that is drawn, and writes that by the image of its centre.
fn drawn_gradient(index: u32, gaussian: Gaussian, placed: Placed) -> DrawnGradient {
    let first = index * SUMS;
    let gradient = shape_vjp(first, placed, gaussian, splat_gradients[first] == DRAWN_CONE);
    splat_gradients[first + 12u] = gradient.centre.x;
    splat_gradients[first + 13u] = gradient.centre.y;
    let by_axes = axes_vjp(gaussian.rotation, gaussian.scale, gradient.axes);
    let shown = vec3(
        drawn_channels[index * CHANNELS],
        drawn_channels[index * CHANNELS + 1u],
        drawn_channels[index * CHANNELS + 2u],
    );
    let by_colour = select(vec3<f32>(), three(first + 14u), shown > vec3<f32>());
    let direction = to_world(placed.point / placed.distance);
    var by_values: array<f32, 15>;
    for (var coefficient = 1u; coefficient < sh_count(view.sh_degree); coefficient++) {
        by_values[coefficient - 1u] = dot(by_colour, harmonic(index, coefficient));
    }
    let by_direction = basis_vjp(view.sh_degree, direction, by_values);
    // d(p/|p|): remove the part along p, divide by the length.
    let through_direction = (by_direction - direction * dot(by_direction, direction))
        / placed.distance;
    let by_gaussian = Gaussian(
        to_world(gradient.point) + through_direction,
        splat_gradients[first + 11u] / gaussian.opacity,
        by_axes.scale + gradient.scale,
        by_axes.rotation,
    );
    return DrawnGradient(by_gaussian, by_colour, basis(view.sh_degree, direction));
}

@compute @workgroup_size(256)
fn project_gaussians_vjp(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) thread: u32,
) {
    let index = workgroup_number(group, groups) * WORKGROUP + thread;
    if index >= view.gaussians {
        return;
    }
    gaussian_gradients[index] = Gaussian();
    let stored = sh_count(view.stored_sh_degree);
    for (var k = 0u; k < stored * 3u; k++) {
        harmonic_gradients[index * stored * 3u + k] = 0.0;
    }
    let first = index * SUMS;
    for (var feature = 0u; feature < CHANNELS - 3u; feature++) {
        feature_gradients[index * (CHANNELS - 3u) + feature] = splat_gradients[first + 17u + feature];
    }
    let gaussian = gaussians[index];
    let placed = place(gaussian);
    // The splat of a Gaussian that is not drawn is stale or unset.
    if !placed.is_seen || splat_gradients[first] == 0.0 {
        return;
    }
    var by = drawn_gradient(index, gaussian, placed);
    gaussian_gradients[index] = by.gaussian;
    for (var coefficient = 0u; coefficient < sh_count(view.sh_degree); coefficient++) {
        var value = SH_C0;
        if coefficient > 0u {
            value = by.basis[coefficient - 1u];
        }
        let place_of_value = (index * stored + coefficient) * 3u;
        harmonic_gradients[place_of_value] = value * by.colour.x;
        harmonic_gradients[place_of_value + 1u] = value * by.colour.y;
        harmonic_gradients[place_of_value + 2u] = value * by.colour.z;
    }
}

fn three(first: u32) -> vec3<f32> {
    return vec3(
        splat_gradients[first],
        splat_gradients[first + 1u],
        splat_gradients[first + 2u],
    );
}

fn shape_vjp(first: u32, placed: Placed, gaussian: Gaussian, is_drawn_as_cone: bool) -> ShapeGradient {
    if is_drawn_as_cone {
        return cone_vjp(
            placed,
            conic(placed, gaussian.scale),
            gaussian.scale,
            three(first + 1u),
            three(first + 4u),
            three(first + 7u),
            splat_gradients[first + 10u],
        );
    }
    return ellipse_vjp(
        placed,
        linearize(placed),
        vec2(splat_gradients[first + 1u], splat_gradients[first + 2u]),
        three(first + 3u),
    );
}
