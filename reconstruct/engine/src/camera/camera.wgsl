// Camera of a view and its model.

const PI: f32 = 3.14159265358979;
const TAU: f32 = 6.28318530717959;

const ERP: u32 = 0u;
const PINHOLE: u32 = 1u;

const FOOTPRINT_PROJECTED: u32 = 0u;
const FOOTPRINT_RAY: u32 = 1u;

struct View {
    // Rows of the world-to-camera rotation; w is not used.
    rotation: array<vec4<f32>, 3>,
    // Camera centre in normalized world units.
    centre: vec3<f32>,
    // Centres nearer than this are not drawn.
    near: f32,
    // Pixels of a pinhole camera.
    focal: vec2<f32>,
    principal: vec2<f32>,
    width: u32,
    height: u32,
    camera: u32,
    // Degrees of the stored harmonics and of those in use.
    stored_sh_degree: u32,
    sh_degree: u32,
    // Number of Gaussians.
    gaussians: u32,
    // Tile entries that the buffers hold.
    entry_capacity: u32,
    // FOOTPRINT_PROJECTED or FOOTPRINT_RAY.
    footprint: u32,
    // Colour behind everything.
    background: vec3<f32>,
    // Square of the low-pass filter's standard deviation as an angle, radians squared.
    angular_low_pass: f32,
}

@group(0) @binding(0) var<uniform> view: View;

// Image of a point, and the two rows of the Jacobian of (u, v) with respect to the point.
struct Projection {
    pixel: vec2<f32>,
    jacobian_u: vec3<f32>,
    jacobian_v: vec3<f32>,
}

fn to_camera(vector: vec3<f32>) -> vec3<f32> {
    return vec3(
        dot(view.rotation[0].xyz, vector),
        dot(view.rotation[1].xyz, vector),
        dot(view.rotation[2].xyz, vector),
    );
}

fn to_world(vector: vec3<f32>) -> vec3<f32> {
    return view.rotation[0].xyz * vector.x + view.rotation[1].xyz * vector.y
        + view.rotation[2].xyz * vector.z;
}

// True if a point of the camera frame is drawn. `distance` is its length and finite.
fn sees(point: vec3<f32>, distance: f32) -> bool {
    return distance > view.near && (view.camera == ERP || point.z > view.near);
}

fn project(point: vec3<f32>, distance: f32) -> Projection {
    if view.camera == ERP {
        return project_erp(point, distance);
    }
    return project_pinhole(point);
}

// Gradient by the point from gradients by the pixel and by the two rows of the Jacobian.
fn project_vjp(
    point: vec3<f32>,
    distance: f32,
    by: Projection,
) -> vec3<f32> {
    if view.camera == ERP {
        return project_erp_vjp(point, distance, by);
    }
    return project_pinhole_vjp(point, by);
}

// Two directions orthogonal to the unit direction `n` and to each other: `[0]` is horizontal
// (towards growing longitude), `[1]` points down.
fn tangent_frame(n: vec3<f32>) -> array<vec3<f32>, 2> {
    let rho = length(n.xz);
    // At a pole longitude is arbitrary; take that of +z.
    var sin_cos = vec2(0.0, 1.0);
    if rho > 0.0 {
        sin_cos = n.xz / rho;
    }
    return array(
        vec3(sin_cos.y, 0.0, -sin_cos.x),
        vec3(-n.y * sin_cos.x, rho, -n.y * sin_cos.y),
    );
}

// Image of a unit direction, pixels.
fn image_of(n: vec3<f32>) -> vec2<f32> {
    if view.camera == ERP {
        return image_of_erp(n);
    }
    return view.focal * n.xy / n.z + view.principal;
}

// Derivatives of a unit direction by its image: dn/du and dn/dv, radians per pixel. Within CONE_RHO of a pole
// of an ERP image, dn/du stops shrinking.
fn pixel_step(n: vec3<f32>) -> array<vec3<f32>, 2> {
    if view.camera == ERP {
        let frame = tangent_frame(n);
        let rho = max(length(n.xz), CONE_RHO);
        return array(
            frame[0] * (rho * TAU / f32(view.width)),
            frame[1] * (PI / f32(view.height)),
        );
    }
    return array(
        (vec3(1.0, 0.0, 0.0) - n * n.x) * (n.z / view.focal.x),
        (vec3(0.0, 1.0, 0.0) - n * n.y) * (n.z / view.focal.y),
    );
}

// Rectangle of the image in pixels; columns of an ERP image continue past both edges.
struct PixelBox {
    centre: vec2<f32>,
    // Half width and half height.
    extent: vec2<f32>,
}

// Larger than any image.
fn everything() -> PixelBox {
    return PixelBox(vec2<f32>(), vec2(1e9));
}

// Bounding rectangle of the cap around the unit direction `n`; `tangent` is that of its angular radius.
fn cap_box(n: vec3<f32>, tangent: f32) -> PixelBox {
    if !is_finite(tangent) || tangent > 1e6 {
        return everything();
    }
    let sine = tangent / sqrt(1.0 + tangent * tangent);
    if view.camera == ERP {
        let rho = length(n.xz);
        let half_height = arc_tangent(tangent, 1.0) / PI * f32(view.height);
        // Widest point of a cap without a pole; a cap with a pole covers every column.
        var half_width = everything().extent.x;
        if sine < rho {
            let share = sine / rho;
            let angle = arc_tangent(share, sqrt(max(1.0 - share * share, 0.0)));
            half_width = angle / TAU * f32(view.width);
        }
        return PixelBox(image_of(n), vec2(half_width, half_height));
    }
    let denominator = n.z * n.z - sine * sine;
    if n.z <= 0.0 || denominator <= 0.0 {
        return everything();
    }
    // Planes through the camera tangent to the cap: (x - u z)^2 = (1 + u^2) sin^2.
    let root = sine * sqrt(max(n.xy * n.xy + denominator, vec2<f32>()));
    return PixelBox(
        n.xy * n.z / denominator * view.focal + view.principal,
        root / denominator * view.focal,
    );
}
