"""The shaders: patterns, three lamps, a window and its shadows."""

SHADOW_VERTEX = """
#version 330
uniform mat4 light;
in vec3 position;
void main() { gl_Position = light * vec4(position, 1.0); }
"""

SHADOW_FRAGMENT = """
#version 330
void main() {}
"""

VERTEX = """
#version 330
uniform mat4 camera;
in vec3 position;
in vec3 normal;
in vec3 rest;
in vec3 colour;
in vec3 second;
in vec2 look;
out vec3 v_position;
out vec3 v_normal;
out vec3 v_rest;
out vec3 v_colour;
out vec3 v_second;
flat out int v_pattern;
out float v_gloss;
void main() {
    gl_Position = camera * vec4(position, 1.0);
    v_position = position;
    v_normal = normal;
    v_rest = rest;
    v_colour = colour;
    v_second = second;
    v_pattern = int(look.x + 0.5);
    v_gloss = look.y;
}
"""

FRAGMENT = """
#version 330
uniform vec3 eye;
uniform mat4 lights[2];
uniform sampler2DShadow shadows0;
uniform sampler2DShadow shadows1;
uniform vec3 lamps[3];
uniform vec3 sun;
uniform vec3 feet[8];
uniform float moving;
in vec3 v_position;
in vec3 v_normal;
in vec3 v_rest;
in vec3 v_colour;
in vec3 v_second;
flat in int v_pattern;
in float v_gloss;
out vec4 result;

float hash(vec3 p) {
    p = fract(p * vec3(0.1031, 0.1030, 0.0973));
    p += dot(p, p.yxz + 33.33);
    return fract((p.x + p.y) * p.z);
}

float noise(vec3 p) {
    vec3 i = floor(p), f = fract(p);
    f = f * f * (3.0 - 2.0 * f);
    return mix(
        mix(mix(hash(i), hash(i + vec3(1, 0, 0)), f.x),
            mix(hash(i + vec3(0, 1, 0)), hash(i + vec3(1, 1, 0)), f.x), f.y),
        mix(mix(hash(i + vec3(0, 0, 1)), hash(i + vec3(1, 0, 1)), f.x),
            mix(hash(i + vec3(0, 1, 1)), hash(i + vec3(1, 1, 1)), f.x), f.y), f.z);
}

vec2 flat_coordinates(vec3 n) {
    vec3 a = abs(n);
    if (a.z > a.x && a.z > a.y) return v_rest.xy;
    return a.x > a.y ? v_rest.yz : v_rest.xz;
}

vec3 painted(vec3 n) {
    vec2 at = flat_coordinates(n);
    if (v_pattern == 1) return v_colour * (0.88 + 0.24 * noise(v_rest * 60.0));
    if (v_pattern == 2)
        return mix(v_colour, v_second, smoothstep(0.45, 0.55, fract(v_rest.z * 14.0)));
    if (v_pattern == 3) {
        float a = smoothstep(0.4, 0.5, fract(v_rest.z * 11.0));
        float b = smoothstep(0.4, 0.5, fract((v_rest.y + v_rest.x) * 11.0));
        return mix(v_colour, v_second, 0.5 * (a + b));
    }
    if (v_pattern == 4) {
        vec2 plank = vec2(at.x / 1.4 + 0.37 * floor(at.y / 0.14), at.y / 0.14);
        vec2 edge = abs(fract(plank) - 0.5);
        float gap = 1.0 - 0.5 * max(smoothstep(0.496, 0.5, edge.x), smoothstep(0.46, 0.5, edge.y));
        float shade = 0.75 + 0.4 * hash(vec3(floor(plank), 3.0));
        float grain = noise(vec3(at.x * 3.0, at.y * 70.0, hash(vec3(floor(plank), 7.0)) * 9.0));
        return v_colour * shade * gap * (0.85 + 0.3 * grain);
    }
    if (v_pattern == 5) {
        float width = at.x * 24.0 + 0.3 * noise(vec3(at.x * 9.0, floor(at.y * 2.8), 1.0));
        vec3 cell = vec3(floor(width), floor(at.y * 2.8), 2.0);
        vec3 hue = vec3(hash(cell), hash(cell + 5.0), hash(cell + 11.0));
        float top = step(fract(at.y * 2.8), 0.55 + 0.3 * hash(cell + 3.0));
        return mix(v_colour * 0.3, mix(v_colour, hue * 0.6, 0.8), top);
    }
    if (v_pattern == 6) {
        vec3 cell = vec3(floor(at * 5.0), 4.0);
        float blot = noise(vec3(at * 7.0, 2.0));
        return mix(v_colour, v_second, smoothstep(0.35, 0.65, blot)) * (0.7 + 0.6 * hash(cell));
    }
    if (v_pattern == 8)
        return v_colour * (0.6 + 0.8 * noise(vec3(v_rest.xy * 90.0, v_rest.z * 12.0)));
    return v_colour;
}

float lit(sampler2DShadow map, mat4 light) {
    vec4 at = light * vec4(v_position, 1.0);
    vec3 p = at.xyz / at.w * 0.5 + 0.5;
    if (p.z > 1.0 || min(p.x, p.y) < 0.0 || max(p.x, p.y) > 1.0) return 1.0;
    float spin = fract(52.98 * fract(dot(gl_FragCoord.xy, vec2(0.0671, 0.00584))));
    vec2 a = 0.0035 * vec2(cos(6.283 * spin), sin(6.283 * spin)), b = 0.6 * vec2(-a.y, a.x);
    p.z -= 0.003;
    return 0.25 * (texture(map, vec3(p.xy + a, p.z)) + texture(map, vec3(p.xy - a, p.z))
                   + texture(map, vec3(p.xy + b, p.z)) + texture(map, vec3(p.xy - b, p.z)));
}

void main() {
    vec3 n = normalize(v_normal);
    vec3 view = normalize(eye - v_position);
    if (dot(n, view) < 0.0 && moving > 0.5) n = -n;
    vec3 albedo = painted(n);
    if (v_pattern >= 1 && v_pattern <= 3 && moving > 0.5) {
        vec3 q = v_rest * vec3(16.0, 16.0, 9.0);
        vec3 bump = vec3(noise(q), noise(q + 17.0), noise(q + 31.0)) - 0.5;
        n = normalize(n + 0.75 * bump);
    }
    if (v_pattern == 7) { result = vec4(v_colour, 1.0); return; }
    vec3 sky = mix(vec3(0.26, 0.23, 0.2), vec3(0.42, 0.43, 0.45), 0.5 + 0.5 * n.z);
    vec3 light = sky;
    vec3 shine = vec3(0.0);
    float shadow0 = lit(shadows0, lights[0]);
    float facing_sun = max(0.0, dot(n, sun));
    float shadow1 = facing_sun > 0.0 ? lit(shadows1, lights[1]) : 0.0;
    for (int k = 0; k < 3; k++) {
        vec3 to = lamps[k] - v_position;
        float distance2 = dot(to, to);
        to *= inversesqrt(distance2);
        float fall = 1.0 / (0.6 + 0.35 * distance2);
        float facing = max(0.0, (dot(n, to) + 0.15) / 1.15) * max(0.0, to.z) * fall;
        vec3 power = vec3(1.9, 1.82, 1.7) * (k == 0 ? shadow0 * 1.6 : 0.75);
        light += power * facing;
        if (v_gloss > 0.05) {
            float spec = pow(max(0.0, dot(n, normalize(to + view))), 8.0 + 60.0 * v_gloss);
            shine += power * v_gloss * spec * fall;
        }
    }
    light += vec3(0.5, 0.58, 0.7) * facing_sun * shadow1;
    float contact = 1.0;
    if (moving < 0.5 && v_position.z < 0.5) for (int k = 0; k < 8; k++) {
        vec3 d = v_position - feet[k];
        contact *= 1.0 - 0.6 * exp(-dot(d, d) / 0.03);
    }
    vec3 c = albedo * light * contact + shine * contact;
    c = c * (1.0 + 0.12 * c) / (1.0 + 0.75 * c);
    result = vec4(pow(c, vec3(1.0 / 2.2)), 1.0);
}
"""
