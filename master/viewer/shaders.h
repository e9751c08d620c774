#pragma once

/// Shaders of the picture (GLSL 3.30). Scene coordinates: nm, z up, taller by `exaggeration` in the overview.
namespace telenano::viewer::shaders {

// The sample: height-coloured, lit by its own slopes, with the tip's soft shadow under it.
inline constexpr const char* kGroundVertex = R"(#version 330 core
layout(location = 0) in vec3 position;   // nm, not exaggerated
layout(location = 1) in vec2 slope;      // dz/dx, dz/dy
layout(location = 2) in float wall;      // 1: a cut side
uniform mat4 clip_of_scene;
uniform float exaggeration;
uniform vec2 ground_min;
uniform vec2 ground_size;
uniform float texture_side;
out vec3 scene;
out vec2 at;
out vec2 slopes;
out float cut;
void main() {
  scene = vec3(position.xy, position.z * exaggeration);
  // Texels stand at the corners of the ground: their middles, not their borders.
  at = ((position.xy - ground_min) / ground_size * (texture_side - 1.0) + 0.5) / texture_side;
  slopes = slope;
  cut = wall;
  gl_Position = clip_of_scene * vec4(scene, 1.0);
})";

// With MAPPED height and slopes come from the texture, without from the corners: looking them up is what
// costs most here, where the processor draws.
inline constexpr const char* kGroundFragment = R"(
in vec3 scene;
in vec2 at;
in vec2 slopes;
in float cut;
uniform sampler2D heights;        // height, dz/dx, dz/dy
uniform sampler2D colours;
uniform float exaggeration;
uniform float lowest;             // nm, not exaggerated
uniform float relief;             // nm; 0: a plane
uniform vec3 light;
uniform vec3 half_way;            // between the light and the eye: where it shines
uniform vec3 tip;                 // apex, scene
uniform float shadow_radius;
uniform float grid_step;          // nm
out vec4 colour;
void main() {
#ifdef MAPPED
  vec3 from_map = texture(heights, at).xyz;
  float height = from_map.x;
  vec2 s = from_map.yz * exaggeration;
#else
  float height = scene.z / exaggeration;
  vec2 s = slopes * exaggeration;
#endif
  float t = relief > 0.0 ? clamp((height - lowest) / relief, 0.0, 1.0) : 0.35;
  vec3 base = texture(colours, vec2(t, 0.5)).rgb;
  vec3 normal = normalize(vec3(-s, 1.0));
  float diffuse = max(dot(normal, light), 0.0);
  float s2 = max(dot(normal, half_way), 0.0);
  s2 *= s2;
  float s8 = s2 * s2 * s2 * s2;
  float shine = s8 * s8 * s8 * s8 * s8;  // the 40th power
  vec3 lit = base * (0.34 + 0.74 * diffuse) + 0.10 * shine;
  vec2 away = scene.xy - tip.xy;
  float above = max(tip.z - scene.z, 0.0);
  float wide = shadow_radius + 0.35 * above;
  float shadow = 0.55 * exp(-dot(away, away) / (wide * wide)) * shadow_radius / wide;
  lit *= 1.0 - shadow;
#ifdef GRID
  vec2 cell = scene.xy / grid_step;
  vec2 from_line = abs(fract(cell - 0.5) - 0.5) / fwidth(cell);
  float line = 1.0 - clamp(min(from_line.x, from_line.y), 0.0, 1.0);
  lit = mix(lit, lit * 1.55 + 0.03, 0.35 * line);
#endif
  vec3 side = base * 0.45 + vec3(0.02, 0.025, 0.035);
  colour = vec4(mix(lit, side, cut), 1.0);
})";

// Solids: tip, lever, cone. The normals come with a rotation and one scale an axis.
inline constexpr const char* kSolidVertex = R"(#version 330 core
layout(location = 0) in vec3 position;
layout(location = 1) in vec3 normal;
uniform mat4 clip_of_scene;
uniform mat4 scene_of_model;
out vec3 normals;
out float depth_y;
void main() {
  vec4 scene = scene_of_model * vec4(position, 1.0);
  depth_y = scene.y;
  normals = transpose(inverse(mat3(scene_of_model))) * normal;
  gl_Position = clip_of_scene * scene;
})";

// With CUT what lies before cut_y is cut away. Without, the driver tests the depth before it shades.
inline constexpr const char* kSolidFragment = R"(
in vec3 normals;
in float depth_y;
uniform vec3 light;
uniform vec3 eye;                 // direction to the camera
uniform vec3 half_way;            // between both: where it shines
uniform float cut_y;
uniform vec3 base;
uniform float alpha;
uniform float ambient;
out vec4 colour;
void main() {
#ifdef CUT
  if (depth_y < cut_y) discard;
#endif
  vec3 normal = normalize(normals);
  if (dot(normal, eye) < 0.0) normal = -normal;
  float diffuse = max(dot(normal, light), 0.0);
  float s2 = max(dot(normal, half_way), 0.0);
  s2 *= s2;
  float s10 = s2 * s2 * s2 * s2 * s2;
  float shine = s10 * s10 * s10 * s10 * s10;  // the 50th power
  float away = 1.0 - max(dot(normal, eye), 0.0);
  float rim = away * away * away;
  colour = vec4(base * (ambient + 0.66 * diffuse) + 0.22 * shine + 0.10 * rim, alpha);
})";

// Lines and points with their colour at each corner, already in clip space.
inline constexpr const char* kLineVertex = R"(#version 330 core
layout(location = 0) in vec4 clip;
layout(location = 1) in vec4 rgba;
uniform float point_size;
out vec4 tint;
void main() {
  tint = rgba;
  gl_Position = clip;
  gl_PointSize = point_size;
})";

inline constexpr const char* kLineFragment = R"(#version 330 core
in vec4 tint;
out vec4 colour;
void main() { colour = tint; })";

}  // namespace telenano::viewer::shaders
