#include "telenano/master/viewer/scene_renderer.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <numbers>
#include <string>

#include "telenano/master/view_model/meshes.h"
#include "telenano/master/view_model/nice_step.h"
#include "telenano/master/viewer/line_batch.h"
#include "telenano/master/viewer/palette.h"
#include "telenano/master/viewer/shaders.h"

namespace telenano::viewer {
namespace {

using view_model::Camera;
using view_model::Ground;
using view_model::Mat4;
using view_model::Rgb;

constexpr double kLeverBend = 0.15;  // of the ground's extent, at most
constexpr int kOutline = 120;        // sides of the tip's outline
constexpr double kAmbient = 0.38;
constexpr double kConeAmbient = 0.62;  // a cone that points down must keep its colour in its own shade

double extent_nm(const Ground& ground) noexcept {
  return std::max(ground.width_nm(), ground.depth_nm());
}

void upload(Buffer& buffer, const view_model::Mesh& mesh) {
  std::vector<float> corners;
  corners.reserve(6 * mesh.corners.size());
  for (const auto& c : mesh.corners) {
    corners.insert(corners.end(), c.pos, c.pos + 3);
    corners.insert(corners.end(), c.normal, c.normal + 3);
  }
  buffer.set(corners, mesh.triangles, GL_DYNAMIC_DRAW);
}

/// Light that goes with the camera, from the upper left and a little from behind the sample: relief shows
/// best so.
Vec3 light_of(const Camera& camera) noexcept {
  Vec3 towards = camera.direction();
  towards.z() = 0;
  return (-0.65 * camera.right() - 0.25 * towards.normalized() + 0.85 * Vec3::UnitZ()).normalized();
}

void set_light(const Program& program, const Camera& camera) {
  const Vec3 light = light_of(camera);
  program.set("light", light);
  program.set("eye", camera.direction());
  program.set("half_way", Vec3((light + camera.direction()).normalized()));
}

/// A model whose z axis becomes `axis`, scaled by `radius` across and `length` along it, its foot at `foot`.
Mat4 along_axis(const Vec3& foot, const Vec3& axis, double radius, double length) noexcept {
  const Vec3 direction = axis.normalized();
  const Vec3 helper = std::abs(direction.z()) < 0.9 ? Vec3::UnitZ() : Vec3::UnitX();
  const Vec3 x = helper.cross(direction).normalized();
  Mat4 m = Mat4::Identity();
  m.block<3, 1>(0, 0) = radius * x;
  m.block<3, 1>(0, 1) = radius * direction.cross(x);
  m.block<3, 1>(0, 2) = length * direction;
  m.block<3, 1>(0, 3) = foot;
  return m;
}

Mat4 moved_to(const Vec3& pos, double scale) noexcept {
  Mat4 m = Mat4::Identity();
  m.block<3, 3>(0, 0) *= scale;
  m.block<3, 1>(0, 3) = pos;
  return m;
}

struct GroundMesh {
  std::vector<float> corners;
  std::vector<std::uint32_t> indices;

  std::uint32_t add(const Vec3& pos, double slope_x, double slope_y, bool wall) {
    for (const double v : {pos.x(), pos.y(), pos.z(), slope_x, slope_y, wall ? 1.0 : 0.0})
      corners.push_back(static_cast<float>(v));
    return static_cast<std::uint32_t>(corners.size() / 6 - 1);
  }
  void quad(std::uint32_t a, std::uint32_t b, std::uint32_t c, std::uint32_t d) {
    indices.insert(indices.end(), {a, b, c, a, c, d});
  }
};

// The whole ground, `cells` a side, and walls down to `floor_nm` so that it looks like the block that it is.
GroundMesh block_mesh(const Ground& ground, const SceneFrame& frame, int cells, double floor_nm) {
  GroundMesh mesh;
  const auto place = [&](int column, int row) {
    const double x = ground.min_w_nm().x() + ground.width_nm() * column / cells;
    const double y = ground.min_w_nm().y() + ground.depth_nm() * row / cells;
    return Vec3(Vec3(x, y, ground.height_w_nm(x, y)) - frame.origin_w_nm);
  };
  for (int row = 0; row <= cells; ++row) {
    for (int column = 0; column <= cells; ++column) mesh.add(place(column, row), 0, 0, false);
  }
  const auto at = [cells](int column, int row) {
    return static_cast<std::uint32_t>(row * (cells + 1) + column);
  };
  for (int row = 0; row < cells; ++row) {
    for (int column = 0; column < cells; ++column)
      mesh.quad(at(column, row), at(column + 1, row), at(column + 1, row + 1), at(column, row + 1));
  }
  const auto wall = [&](auto&& place_of) {
    for (int i = 0; i < cells; ++i) {
      const Vec3 a = place_of(i);
      const Vec3 b = place_of(i + 1);
      const Vec3 down(0, 0, floor_nm);
      const auto low = [&](const Vec3& p) { return Vec3(p.x(), p.y(), down.z()); };
      mesh.quad(mesh.add(a, 0, 0, true), mesh.add(low(a), 0, 0, true), mesh.add(low(b), 0, 0, true),
                mesh.add(b, 0, 0, true));
    }
  };
  wall([&](int i) { return place(i, 0); });
  wall([&](int i) { return place(i, cells); });
  wall([&](int i) { return place(0, i); });
  wall([&](int i) { return place(cells, i); });
  return mesh;
}

/// Beside the part of the sample that is shown.
bool beside(const SceneState& state, const Vec3& pos_w_nm) noexcept {
  const Vec3& low = state.ground.min_w_nm();
  const Vec3& high = state.ground.max_w_nm();
  return state.part && (pos_w_nm.x() < low.x() || pos_w_nm.x() > high.x() || pos_w_nm.y() < low.y() ||
                        pos_w_nm.y() > high.y());
}

/// A shader with these definitions.
std::string with(const char* definitions, const char* source) {
  return std::string("#version 330 core\n") + definitions + source;
}

}  // namespace

SceneRenderer::SceneRenderer(const Ground& ground)
    : solid_program_("solid", shaders::kSolidVertex, with("", shaders::kSolidFragment).c_str()),
      cut_program_("cut solid", shaders::kSolidVertex,
                   with("#define CUT\n", shaders::kSolidFragment).c_str()),
      line_program_("line", shaders::kLineVertex, shaders::kLineFragment),
      overview_({3, 2, 1}),
      patch_({3, 2, 1}),
      sphere_({3, 3}),
      half_sphere_({3, 3}),
      cone_({3, 3}),
      disc_({3, 3}),
      shank_({3, 3}),
      lever_({3, 3}),
      lines_({4, 4}) {
  const auto table = view_model::height_colour_table();
  colours_.set_rgb8(view_model::kHeightColours, 1, table);
  upload(sphere_, view_model::unit_sphere(20, 40));
  upload(half_sphere_, view_model::half_sphere(20, 20));
  upload(cone_, view_model::unit_cone(40));
  upload(disc_, view_model::unit_cone(kOutline));
  upload(shank_, view_model::frustum(0.45, 1.0, 32));
  set_ground(ground);
}

void SceneRenderer::set_ground(const Ground& ground) {
  texture_side_ = ground.texture_side();
  heights_.set_rgb32f(texture_side_, texture_side_, ground.height_texture(texture_side_));
  const SceneFrame frame = overview_frame(ground);
  const double floor_nm = -0.035 * extent_nm(ground) / frame.exaggeration;
  const GroundMesh mesh = block_mesh(ground, frame, ground.is_scan() ? kOverviewCells : 1, floor_nm);
  overview_.set(mesh.corners, mesh.indices, GL_STATIC_DRAW);
}

SceneFrame SceneRenderer::overview_frame(const Ground& ground) {
  SceneFrame frame = close_up_frame(ground);
  frame.exaggeration = ground.overview_exaggeration();
  return frame;
}

SceneFrame SceneRenderer::close_up_frame(const Ground& ground) {
  SceneFrame frame;
  frame.origin_w_nm = 0.5 * (ground.min_w_nm() + ground.max_w_nm());
  frame.origin_w_nm.z() = ground.min_w_nm().z();
  return frame;
}

double SceneRenderer::lever_exaggeration(const Ground& ground, double full_nm) noexcept {
  return std::max(1.0, view_model::nice_step(kLeverBend * extent_nm(ground) / full_nm));
}

void SceneRenderer::begin(const Area& area, int canvas_height_px) const {
  const int from_below = canvas_height_px - area.y_px - area.height_px;
  glViewport(area.x_px, from_below, area.width_px, area.height_px);
  glScissor(area.x_px, from_below, area.width_px, area.height_px);
  glEnable(GL_SCISSOR_TEST);
  glEnable(GL_DEPTH_TEST);
  glDepthMask(GL_TRUE);
  glDisable(GL_CULL_FACE);
  glDisable(GL_BLEND);
  glBlendFunc(GL_SRC_ALPHA, GL_ONE_MINUS_SRC_ALPHA);
  const Rgb& c = palette::kBackground;
  glClearColor(c.r, c.g, c.b, 1);
  glClear(GL_COLOR_BUFFER_BIT | GL_DEPTH_BUFFER_BIT);
}

void SceneRenderer::use_ground(const SceneState& state, const Camera& camera, const SceneFrame& frame,
                               const Mat4& clip, bool from_texture) {
  const Ground& ground = state.ground;
  const bool grid = !ground.is_scan();
  const Program& p = ground_program(from_texture, grid);
  p.use();
  if (from_texture) {
    heights_.bind(0);
    p.set("heights", 0);
  }
  colours_.bind(1);
  p.set("colours", 1);
  p.set("clip_of_scene", clip);
  p.set("exaggeration", frame.exaggeration);
  const Vec3 corner = ground.min_w_nm() - frame.origin_w_nm;
  p.set("ground_min", corner.x(), corner.y());
  p.set("ground_size", ground.width_nm(), ground.depth_nm());
  p.set("texture_side", static_cast<double>(texture_side_));
  // Heights in the texture are those of frame W, those at the corners of the patch are of the scene.
  p.set("lowest", from_texture ? ground.min_w_nm().z() : 0.0);
  p.set("relief", ground.relief_nm());
  set_light(p, camera);
  p.set("tip", frame.scene_nm(state.tip_pos_w_nm));
  p.set("shadow_radius", state.tip.radius_nm);
  if (grid) p.set("grid_step", view_model::nice_step(0.05 * camera.nm_per_pixel(1)));
}

const Program& SceneRenderer::ground_program(bool mapped, bool grid) {
  std::unique_ptr<Program>& program = ground_programs_[(mapped ? 1u : 0u) + (grid ? 2u : 0u)];
  if (!program) {
    const std::string definitions =
        std::string(mapped ? "#define MAPPED\n" : "") + (grid ? "#define GRID\n" : "");
    program = std::make_unique<Program>("ground", shaders::kGroundVertex,
                                        with(definitions.c_str(), shaders::kGroundFragment).c_str());
  }
  return *program;
}

void SceneRenderer::use_solids(const Program& program, const Camera& camera, const Mat4& clip) {
  program.use();
  program.set("clip_of_scene", clip);
  set_light(program, camera);
  program.set("ambient", kAmbient);
}

void SceneRenderer::draw_solid(const Program& program, const Buffer& mesh, const Mat4& scene_of_model,
                               const Rgb& colour, double alpha) {
  program.set("scene_of_model", scene_of_model);
  program.set("base", colour);
  program.set("alpha", alpha);
  mesh.draw(GL_TRIANGLES);
}

void SceneRenderer::draw_cone(const SceneState& state, const Vec3& foot_nm, double radius_nm,
                              double full_nm) const {
  const double force_nn = state.force_w_nn.norm();
  const double part = std::min(force_nn / state.force_full_nn, 1.0);
  if (!(part > 0.005)) return;
  const Rgb& colour = state.force_w_nn.z() >= 0 ? palette::kRepulsion : palette::kAttraction;
  solid_program_.set("ambient", kConeAmbient);
  draw_solid(cone_, along_axis(foot_nm, state.force_w_nn, radius_nm, full_nm * part), colour, 0.95);
  solid_program_.set("ambient", kAmbient);
}

void SceneRenderer::draw_trail(const SceneState& state, const Mat4& clip, const SceneFrame& frame,
                               const Area& area, double wide_px) {
  LineBatch batch(clip, area.width_px, area.height_px);
  const auto& trail = state.trail;
  for (std::size_t i = 1; i < trail.size(); ++i) {
    const auto& from = trail.point(i - 1);
    const auto& to = trail.point(i);
    if (beside(state, to.pos_w_nm) || beside(state, from.pos_w_nm)) continue;
    const double age = 1 - static_cast<double>(i) / static_cast<double>(trail.size());
    const Rgb& colour = to.contact ? palette::kRepulsion : palette::kFree;
    batch.add(frame.scene_nm(from.pos_w_nm), frame.scene_nm(to.pos_w_nm), colour,
              (to.contact ? 0.95 : 0.6) * (1 - 0.85 * age), to.contact ? 1.3 * wide_px : wide_px);
  }
  lines_.set(batch.corners(), GL_STREAM_DRAW);
  line_program_.use();
  line_program_.set("point_size", 1.0);
  lines_.draw(GL_TRIANGLES);
}

void SceneRenderer::draw_overview(const SceneState& state, const Camera& camera, const SceneFrame& frame,
                                  const Area& area, int canvas_height_px) {
  begin(area, canvas_height_px);
  const Mat4 clip = camera.clip_of_scene(area.aspect());
  use_ground(state, camera, frame, clip, true);
  overview_.draw(GL_TRIANGLES);

  const double extent = extent_nm(state.ground);
  const double radius = state.tip.radius_nm;
  const Vec3 apex = frame.scene_nm(state.tip_pos_w_nm);
  const Vec3 middle = apex + radius * Vec3::UnitZ();
  const double shank_nm = 0.13 * extent;
  use_solids(solid_program_, camera, clip);
  draw_solid(sphere_, moved_to(middle, radius), palette::kTip, 1);
  draw_solid(shank_, along_axis(middle, Vec3::UnitZ(), 0.6 * radius + 0.006 * extent, shank_nm),
             palette::kTip, 1);
  const Vec3 end = middle + (shank_nm + 0.008 * extent) * Vec3::UnitZ();
  const double bend_nm =
      std::clamp(state.deflection_nm * state.lever_exaggeration, -0.3 * extent, 0.3 * extent);
  upload(lever_, view_model::bent_lever(0.45 * extent, 0.085 * extent, 0.01 * extent, bend_nm, 24));
  draw_solid(lever_, moved_to(end, 1), palette::kLever, 1);
  if (state.particle.radius_nm > 0 && !beside(state, state.particle.pos_w_nm)) {
    // Taller heights must not make an egg of it: it stands on its lowest point, as the tip does.
    const double r = state.particle.radius_nm;
    const Vec3 foot = frame.scene_nm(state.particle.pos_w_nm - r * Vec3::UnitZ());
    draw_solid(sphere_, moved_to(foot + r * Vec3::UnitZ(), r), palette::kParticle, 1);
  }
  glEnable(GL_BLEND);
  const Vec3 direction = state.force_w_nn.norm() > 0 ? Vec3(state.force_w_nn.normalized()) : Vec3::UnitZ();
  draw_cone(state, middle + 0.6 * radius * direction, 1.15 * radius, 0.24 * extent);

  glDepthMask(GL_FALSE);
  if (!state.ground.is_scan() && !state.touched.points_w_nm().empty()) {
    LineBatch points(clip, area.width_px, area.height_px);
    const double low = state.touched.lowest_nm();
    const double range = std::max(state.touched.highest_nm() - low, 1e-3);
    for (const Vec3& p : state.touched.points_w_nm()) {
      if (beside(state, p)) continue;
      points.add_point(frame.scene_nm(p), view_model::height_colour((p.z() - low) / range), 0.9);
    }
    lines_.set(points.corners(), GL_STREAM_DRAW);
    glEnable(GL_PROGRAM_POINT_SIZE);
    line_program_.use();
    line_program_.set("point_size", 3.0);
    lines_.draw(GL_POINTS);
  }
  // The trail is drawn over what it goes through: a groove or a dent would hide it otherwise.
  glDisable(GL_DEPTH_TEST);
  draw_trail(state, clip, frame, area, 1.6);
  glEnable(GL_DEPTH_TEST);
  LineBatch drop(clip, area.width_px, area.height_px);
  Vec3 foot = state.tip_pos_w_nm;
  foot.z() = state.ground.height_w_nm(foot.x(), foot.y());
  drop.add(apex, frame.scene_nm(foot), palette::kText, 0.7, 1.2);
  lines_.set(drop.corners(), GL_STREAM_DRAW);
  line_program_.use();
  lines_.draw(GL_TRIANGLES);
  glDepthMask(GL_TRUE);
  glDisable(GL_BLEND);
  glDisable(GL_SCISSOR_TEST);
}

void SceneRenderer::fill_patch(const SceneState& state, const SceneFrame& frame, double half_nm,
                               double floor_nm) {
  const Ground& ground = state.ground;
  const Vec3& tip = state.tip_pos_w_nm;
  GroundMesh mesh;
  const double step = 2 * half_nm / kPatchCells;
  std::vector<double> z(static_cast<std::size_t>((kPatchCells + 3) * (kPatchCells + 3)));
  const auto x_of = [&](int column) { return tip.x() - half_nm + column * step; };
  const auto y_of = [&](int row) { return tip.y() + row * step; };
  const auto z_at = [&](int column, int row) -> double& {
    return z[static_cast<std::size_t>((row + 1) * (kPatchCells + 3) + column + 1)];
  };
  for (int row = -1; row <= kPatchCells + 1; ++row) {
    for (int column = -1; column <= kPatchCells + 1; ++column)
      z_at(column, row) = ground.height_w_nm(x_of(column), y_of(row));
  }
  const auto place = [&](int column, int row) {
    return Vec3(Vec3(x_of(column), y_of(row), z_at(column, row)) - frame.origin_w_nm);
  };
  for (int row = 0; row <= kPatchCells; ++row) {
    for (int column = 0; column <= kPatchCells; ++column) {
      mesh.add(place(column, row), (z_at(column + 1, row) - z_at(column - 1, row)) / (2 * step),
               (z_at(column, row + 1) - z_at(column, row - 1)) / (2 * step), false);
    }
  }
  const auto at = [](int column, int row) {
    return static_cast<std::uint32_t>(row * (kPatchCells + 1) + column);
  };
  for (int row = 0; row < kPatchCells; ++row) {
    for (int column = 0; column < kPatchCells; ++column)
      mesh.quad(at(column, row), at(column + 1, row), at(column + 1, row + 1), at(column, row + 1));
  }
  for (int column = 0; column < kPatchCells; ++column) {
    const Vec3 a = place(column, 0);
    const Vec3 b = place(column + 1, 0);
    mesh.quad(mesh.add(a, 0, 0, true), mesh.add({a.x(), a.y(), floor_nm}, 0, 0, true),
              mesh.add({b.x(), b.y(), floor_nm}, 0, 0, true), mesh.add(b, 0, 0, true));
  }
  patch_.set(mesh.corners, mesh.indices, GL_STREAM_DRAW);
}

// Cut by the plane through the tip, where that meets it; what is behind the plane whole, what is before it
// not.
void SceneRenderer::draw_particle_cut_open(const SceneState& state, const Camera& camera,
                                           const SceneFrame& frame, const Mat4& clip) const {
  const double radius = state.particle.radius_nm;
  if (!(radius > 0)) return;
  const Vec3 centre = frame.scene_nm(state.particle.pos_w_nm);
  use_solids(cut_program_, camera, clip);
  cut_program_.set("cut_y", frame.scene_nm(state.tip_pos_w_nm).y() + 0.01 * state.tip.radius_nm);
  draw_solid(cut_program_, sphere_, moved_to(centre, radius), palette::kParticle, 1);
  solid_program_.use();
  const double plane_y = frame.scene_nm(state.tip_pos_w_nm).y();
  const double off = centre.y() - plane_y;
  if (std::abs(off) >= radius) return;
  const Vec3 before_cut(centre.x(), plane_y - 0.02 * state.tip.radius_nm, centre.z());
  draw_solid(disc_,
             along_axis(before_cut, Vec3::UnitY(), std::sqrt(radius * radius - off * off), 1e-3 * radius),
             palette::kParticleCut, 1);
}

void SceneRenderer::draw_close_up(const SceneState& state, const Camera& camera, const SceneFrame& frame,
                                  const Area& area, int canvas_height_px) {
  begin(area, canvas_height_px);
  const Mat4 clip = camera.clip_of_scene(area.aspect());
  const double half_nm = 1.15 * camera.half_height_nm * area.aspect();
  // The tip is cut open along the same plane as the sample, so that its outline there is the true one. What
  // is in front comes first: what it hides need not be shaded.
  const double radius = state.tip.radius_nm;
  const Vec3 apex = frame.scene_nm(state.tip_pos_w_nm);
  const Vec3 middle = apex + radius * Vec3::UnitZ();
  use_solids(solid_program_, camera, clip);
  const Vec3 before_cut = middle - 0.02 * radius * Vec3::UnitY();  // wins against the sample's cut
  draw_solid(disc_, along_axis(before_cut, Vec3::UnitY(), radius, 1e-3 * radius), palette::kLever, 1);
  // Behind the sample's cut, whatever rounding does.
  draw_solid(half_sphere_, moved_to(middle + 0.01 * radius * Vec3::UnitY(), radius), palette::kTip, 1);
  draw_particle_cut_open(state, camera, frame, clip);
  fill_patch(state, frame, half_nm, camera.target_nm.z() - 3 * camera.half_height_nm);
  use_ground(state, camera, frame, clip, false);
  patch_.draw(GL_TRIANGLES);
  use_solids(solid_program_, camera, clip);
  glEnable(GL_BLEND);
  glDepthMask(GL_FALSE);
  glDisable(GL_DEPTH_TEST);
  draw_cone(state, apex, 0.07 * camera.half_height_nm, kConeInCloseUp * camera.half_height_nm);
  draw_trail(state, clip, frame, area, 1.3);
  LineBatch profile(clip, area.width_px, area.height_px);
  Vec3 before = Vec3::Zero();
  for (int i = 0; i <= kPatchCells; ++i) {
    Vec3 here = state.tip_pos_w_nm;
    here.x() += half_nm * (2.0 * i / kPatchCells - 1);
    here.z() = state.ground.height_w_nm(here.x(), here.y());
    here = frame.scene_nm(here);
    if (i > 0) profile.add(before, here, palette::kText, 0.9, 1.6);
    before = here;
  }
  for (int i = 0; i < kOutline; ++i) {
    const auto rim = [&](int k) {
      const double around = 2 * std::numbers::pi * k / kOutline;
      return Vec3(middle + radius * Vec3(std::cos(around), 0, std::sin(around)));
    };
    profile.add(rim(i), rim(i + 1), palette::kTip, 1, 1.8);
  }
  lines_.set(profile.corners(), GL_STREAM_DRAW);
  line_program_.use();
  lines_.draw(GL_TRIANGLES);
  glDepthMask(GL_TRUE);
  glEnable(GL_DEPTH_TEST);
  glDisable(GL_BLEND);
  glDisable(GL_SCISSOR_TEST);
}

}  // namespace telenano::viewer
