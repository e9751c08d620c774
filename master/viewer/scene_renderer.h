#pragma once

#include <array>
#include <memory>

#include "telenano/master/view_model/camera.h"
#include "telenano/master/view_model/ground.h"
#include "telenano/master/viewer/gl.h"
#include "telenano/master/viewer/scene_state.h"

namespace telenano::viewer {

/// A part of the picture, pixels from its upper left corner.
struct Area {
  int x_px = 0;
  int y_px = 0;
  int width_px = 0;
  int height_px = 0;
  bool contains(double x, double y) const noexcept {
    return x >= x_px && y >= y_px && x < x_px + width_px && y < y_px + height_px;
  }
  double aspect() const noexcept { return static_cast<double>(width_px) / height_px; }
};

/// How frame W is drawn: about the middle of the ground, heights above its lowest point, taller by a factor.
struct SceneFrame {
  Vec3 origin_w_nm = Vec3::Zero();
  double exaggeration = 1;
  Vec3 scene_nm(const Vec3& pos_w_nm) const noexcept {
    const Vec3 d = pos_w_nm - origin_w_nm;
    return {d.x(), d.y(), d.z() * exaggeration};
  }
};

/// Draws the sample, or the part of it that set_ground() has, and the probe. The overview is a mesh of at most kOverviewCells² cells whatever the scan,
/// lit from a texture of all its slopes; the close-up a fine patch that goes with the tip, cut open along the
/// tip's x–z plane.
class SceneRenderer {
 public:
  static constexpr int kOverviewCells = 64;
  static constexpr int kPatchCells = 40;
  static constexpr double kConeInCloseUp = 0.7;  ///< length of the full cone over half the picture's height

  explicit SceneRenderer(const view_model::Ground& ground);
  /// That the overview shows; the close-up draws its state's.
  void set_ground(const view_model::Ground& ground);

  /// `canvas_height_px`: of the whole picture, since OpenGL counts from below.
  void draw_overview(const SceneState& state, const view_model::Camera& camera, const SceneFrame& frame,
                     const Area& area, int canvas_height_px);
  /// `frame` without exaggeration; `camera` orthographic along +y.
  void draw_close_up(const SceneState& state, const view_model::Camera& camera, const SceneFrame& frame,
                     const Area& area, int canvas_height_px);

  static SceneFrame overview_frame(const view_model::Ground& ground);
  static SceneFrame close_up_frame(const view_model::Ground& ground);
  /// Exaggeration of the lever's deflection so that `full_nm` of it can be seen in the overview.
  static double lever_exaggeration(const view_model::Ground& ground, double full_nm) noexcept;

 private:
  void begin(const Area& area, int canvas_height_px) const;
  void use_ground(const SceneState& state, const view_model::Camera& camera, const SceneFrame& frame,
                  const view_model::Mat4& clip, bool from_texture);
  static void draw_solid(const Program& program, const Buffer& mesh, const view_model::Mat4& scene_of_model,
                         const view_model::Rgb& colour, double alpha);
  void draw_solid(const Buffer& mesh, const view_model::Mat4& scene_of_model, const view_model::Rgb& colour,
                  double alpha) const {
    draw_solid(solid_program_, mesh, scene_of_model, colour, alpha);
  }
  void draw_particle_cut_open(const SceneState& state, const view_model::Camera& camera,
                              const SceneFrame& frame, const view_model::Mat4& clip) const;
  void draw_cone(const SceneState& state, const Vec3& foot_nm, double radius_nm, double full_nm) const;
  static void use_solids(const Program& program, const view_model::Camera& camera,
                         const view_model::Mat4& clip);
  void draw_trail(const SceneState& state, const view_model::Mat4& clip, const SceneFrame& frame,
                  const Area& area, double wide_px);
  void fill_patch(const SceneState& state, const SceneFrame& frame, double half_nm, double floor_nm);

  const Program& ground_program(bool mapped, bool grid);

  std::array<std::unique_ptr<Program>, 4> ground_programs_;  ///< each made when it is first needed
  Program solid_program_;
  Program cut_program_;
  Program line_program_;
  Texture heights_;
  Texture colours_;
  int texture_side_ = 2;
  Buffer overview_;
  Buffer patch_;
  Buffer sphere_;
  Buffer half_sphere_;
  Buffer cone_;
  Buffer disc_;
  Buffer shank_;
  Buffer lever_;
  Buffer lines_;
};

}  // namespace telenano::viewer
