// Ellipse of a Gaussian linearized in the image, and its VJP.

// Intermediate values shared by forward and backward.
struct Linearization {
    pixel: vec2<f32>,
    // Rows of J W, in world coordinates.
    to_u: vec3<f32>,
    to_v: vec3<f32>,
    // Rows of V = J W M.
    v_u: vec3<f32>,
    v_v: vec3<f32>,
    // A, B, C of the covariance.
    covariance: vec3<f32>,
    determinant: f32,
}

// Gradients of a footprint's shape.
struct ShapeGradient {
    // Gradient by the centre, in the camera frame.
    point: vec3<f32>,
    // Gradient by the axes, in world coordinates.
    axes: mat3x3<f32>,
    // Gradient by the scales, except through the axes.
    scale: vec3<f32>,
    // Gradient by the centre's image with the shape fixed, per pixel.
    centre: vec2<f32>,
}

fn linearize(placed: Placed) -> Linearization {
    let projection = project(placed.point, placed.distance);
    let to_u = to_world(projection.jacobian_u);
    let to_v = to_world(projection.jacobian_v);
    let v_u = to_u * placed.axes;
    let v_v = to_v * placed.axes;
    let uu = dot(v_u, v_u);
    let vv = dot(v_v, v_v);
    let normal = cross(v_u, v_v);
    return Linearization(
        projection.pixel,
        to_u,
        to_v,
        v_u,
        v_v,
        vec3(uu + LOW_PASS, dot(v_u, v_v), vv + LOW_PASS),
        dot(normal, normal) + LOW_PASS * (uu + vv) + LOW_PASS * LOW_PASS,
    );
}

// Inverse variance, slope, inverse row variance.
fn ellipse(linear: Linearization) -> vec3<f32> {
    let c = linear.covariance.z;
    return vec3(c / linear.determinant, linear.covariance.y / c, 1.0 / c);
}

fn ellipse_vjp(
    placed: Placed,
    linear: Linearization,
    by_centre: vec2<f32>,
    by_shape: vec3<f32>,
) -> ShapeGradient {
    let shape = ellipse(linear);
    let slope = shape.y;
    let row = shape.z;
    // variance = A - B^2/C, slope = B/C, row = 1/C.
    let by_a = -shape.x * shape.x * by_shape.x;
    let by_b = -2.0 * slope * by_a + row * by_shape.y;
    let by_c = slope * slope * by_a - slope * row * by_shape.y - row * row * by_shape.z;
    // Sigma = V V^T + 0.3 I.
    let dv_u = 2.0 * by_a * linear.v_u + by_b * linear.v_v;
    let dv_v = by_b * linear.v_u + 2.0 * by_c * linear.v_v;
    // V = (J W) M.
    let by = Projection(
        by_centre,
        to_camera(placed.axes * dv_u),
        to_camera(placed.axes * dv_v),
    );
    return ShapeGradient(
        project_vjp(placed.point, placed.distance, by),
        mat3x3(
            dv_u.x * linear.to_u + dv_v.x * linear.to_v,
            dv_u.y * linear.to_u + dv_v.y * linear.to_v,
            dv_u.z * linear.to_u + dv_v.z * linear.to_v,
        ),
        vec3<f32>(),
        by_centre,
    );
}
