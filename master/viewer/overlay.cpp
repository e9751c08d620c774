#include "telenano/master/viewer/overlay.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <utility>
#include <vector>

#include "telenano/master/view_model/nice_step.h"
#include "telenano/master/view_model/session_banner.h"
#include "telenano/master/view_model/status_text.h"

namespace telenano::viewer {
namespace {

using view_model::Camera;
using view_model::Mat4;
using view_model::Mood;
using view_model::ScreenPoint;

palette::Rgb colour_of(Mood mood) {
  switch (mood) {
    case Mood::kGood:
      return palette::kGood;
    case Mood::kWarning:
      return palette::kWarning;
    case Mood::kAlarm:
      return palette::kAlarm;
    case Mood::kCalm:
      break;
  }
  return palette::kQuiet;
}

ImVec2 text_size(const ImFont* font, const char* text) {
  return font->CalcTextSizeA(font->FontSize, 1e9f, 0, text);
}

/// As much of it as fits, and an ellipsis where that is not all.
std::string cut_to(const ImFont* font, std::string text, float wide) {
  if (text_size(font, text.c_str()).x <= wide) return text;
  const float room = wide - text_size(font, "…").x;
  while (text.size() > 1 && text_size(font, text.c_str()).x > room) {
    while (text.size() > 1 && (static_cast<unsigned char>(text.back()) & 0xC0) == 0x80) text.pop_back();
    text.pop_back();
  }
  return text + "…";
}

constexpr double kConeHalves = SceneRenderer::kConeInCloseUp;  // of half the picture's height

// Draws in one picture: nothing leaves it.
class Pen {
 public:
  Pen(const Gui& gui, const Camera& camera, const SceneFrame& frame, const Area& area)
      : list_(ImGui::GetBackgroundDrawList()),
        gui_(gui),
        clip_(camera.clip_of_scene(area.aspect())),
        frame_(frame),
        area_(area) {
    list_->PushClipRect(
        {static_cast<float>(area.x_px), static_cast<float>(area.y_px)},
        {static_cast<float>(area.x_px + area.width_px), static_cast<float>(area.y_px + area.height_px)});
  }
  ~Pen() { list_->PopClipRect(); }
  Pen(const Pen&) = delete;
  Pen& operator=(const Pen&) = delete;

  ImVec2 at(const Vec3& pos_w_nm) const {
    const ScreenPoint p =
        view_model::project(clip_, frame_.scene_nm(pos_w_nm), area_.width_px, area_.height_px);
    return {static_cast<float>(area_.x_px + p.x_px), static_cast<float>(area_.y_px + p.y_px)};
  }
  ImDrawList* list() const { return list_; }
  float left() const { return static_cast<float>(area_.x_px); }
  float top() const { return static_cast<float>(area_.y_px); }
  float right() const { return static_cast<float>(area_.x_px + area_.width_px); }
  float bottom() const { return static_cast<float>(area_.y_px + area_.height_px); }
  float s() const { return gui_.scale(); }

  /// `anchor`: which part of the text stands there, 0 … 1 from left and top. At an edge of the picture it moves in, by half of
  /// itself at most: what is farther out belongs to nothing that is in sight. False: other words stand there, or it would be
  /// cut, and nothing is written.
  bool text(ImVec2 where, const std::string& words, const palette::Rgb& colour, ImVec2 anchor = {0, 0},
            const ImFont* font = nullptr) const {
    if (font == nullptr) font = gui_.small();
    const ImVec2 size = text_size(font, words.c_str());
    const ImVec2 wanted{where.x - anchor.x * size.x, where.y - anchor.y * size.y};
    const float margin = 2 * s();
    const ImVec2 p{std::max(std::min(wanted.x, right() - margin - size.x), left() + margin),
                   std::max(std::min(wanted.y, bottom() - margin - size.y), top() + margin)};
    if (std::abs(p.x - wanted.x) > 0.5f * size.x || std::abs(p.y - wanted.y) > 0.5f * size.y) return false;
    if (!gui_.words().take_if_free(p, {p.x + size.x, p.y + size.y})) return false;
    write(p, words, colour, font);
    return true;
  }

  struct Line {
    std::string words;
    palette::Rgb colour;
    const ImFont* font;
  };
  /// Lines under each other, which belong together: at the first of `places` (their upper left corner, moved
  /// into the picture) where no other words stand, else as near to it as there is room.
  void block(const std::vector<Line>& lines, const std::vector<ImVec2>& places) const {
    ImVec2 size{0, 0};
    for (const Line& line : lines) {
      const ImVec2 one = text_size(line.font, line.words.c_str());
      size = {std::max(size.x, one.x), size.y + one.y};
    }
    const float margin = 4 * s();
    const ImVec2 low{left() + margin, top() + margin};
    const ImVec2 high{right() - margin - size.x, bottom() - margin - size.y};
    const auto inside = [&](ImVec2 p) {
      return ImVec2{std::max(std::min(p.x, high.x), low.x), std::max(std::min(p.y, high.y), low.y)};
    };
    const auto put = [&](ImVec2 p) {
      if (!gui_.words().take_if_free(p, {p.x + size.x, p.y + size.y})) return false;
      for (const Line& line : lines) {
        write(p, line.words, line.colour, line.font);
        p.y += text_size(line.font, line.words.c_str()).y;
      }
      return true;
    };
    for (const ImVec2& place : places) {
      if (put(inside(place))) return;
    }
    const ImVec2 wanted = inside(places.front());
    const float step = 6 * s();
    for (float away = step; away < bottom() - top(); away += step) {
      for (const ImVec2& p : {ImVec2{wanted.x, wanted.y + away}, ImVec2{wanted.x, wanted.y - away},
                              ImVec2{low.x, wanted.y + away}, ImVec2{low.x, wanted.y - away},
                              ImVec2{high.x, wanted.y + away}, ImVec2{high.x, wanted.y - away}}) {
        if (put(inside(p))) return;
      }
    }
  }
  void line(ImVec2 a, ImVec2 b, const palette::Rgb& colour, float wide = 1, float alpha = 1) const {
    list_->AddLine(a, b, ink(colour, alpha), wide * s());
  }

 private:
  void write(ImVec2 p, const std::string& words, const palette::Rgb& colour, const ImFont* font) const {
    const float o = s();
    // A dark edge keeps it readable on bright ground.
    for (const auto& [dx, dy] : {std::pair{-o, 0.f}, {o, 0.f}, {0.f, -o}, {0.f, o}})
      list_->AddText(font, font->FontSize, {p.x + dx, p.y + dy}, ink(palette::kBackground, 0.75f),
                     words.c_str());
    list_->AddText(font, font->FontSize, p, ink(colour), words.c_str());
  }

  ImDrawList* list_;
  const Gui& gui_;
  Mat4 clip_;
  SceneFrame frame_;
  Area area_;
};

// A lying or standing arrow from the tip to where the hand wants it would hide more than it tells: a diamond.
void draw_target(const Pen& pen, const SceneState& state) {
  const ImVec2 p = pen.at(state.target_pos_w_nm);
  const float r = 5 * pen.s();
  pen.list()->AddQuad({p.x - r, p.y}, {p.x, p.y - r}, {p.x + r, p.y}, {p.x, p.y + r},
                      ink(palette::kTarget, 0.95f), 1.6f * pen.s());
}

// Ticks and lengths along the two edges of the ground that face the camera.
void draw_axes(const Pen& pen, const SceneState& state, const Camera& camera) {
  const auto& ground = state.ground;
  const Vec3 low = ground.min_w_nm();
  const Vec3 high = ground.max_w_nm();
  const Vec3 towards = camera.direction();
  const double y_edge = towards.y() < 0 ? low.y() : high.y();
  const double x_edge = towards.x() < 0 ? low.x() : high.x();
  const double step = view_model::nice_step(0.4 * std::max(ground.width_nm(), ground.depth_nm()));
  const double z = low.z();
  const double out = 0.03 * std::max(ground.width_nm(), ground.depth_nm());
  for (int axis = 0; axis < 2; ++axis) {
    const double from = low[axis];
    const double to = high[axis];
    Vec3 outward = Vec3::Zero();
    outward[1 - axis] = axis == 0 ? (y_edge == low.y() ? -out : out) : (x_edge == low.x() ? -out : out);
    const auto place = [&](double along) {
      return axis == 0 ? Vec3(along, y_edge, z) : Vec3(x_edge, along, z);
    };
    for (double v = std::ceil(from / step - 1e-9) * step; v <= to + 1e-9 * step; v += step) {
      const ImVec2 a = pen.at(place(v));
      const ImVec2 b = pen.at(place(v) + outward);
      pen.line(a, b, palette::kQuiet);
      pen.text(pen.at(place(v) + 2.3 * outward), fmt::format("{:g}", v), palette::kQuiet, {0.5f, 0.5f});
    }
    pen.text(pen.at(place(0.5 * (from + to)) + 4.6 * outward), axis == 0 ? "x (nm)" : "y (nm)",
             palette::kText, {0.5f, 0.5f});
  }
}

/// Where the tip can be led no further: a line, hatched outside of it.
void draw_walls(const Pen& pen, const SceneState& state) {
  const float s = pen.s();
  const auto wall = [&](double x_w_nm, double z_w_nm, float out_x, float out_y) {
    if (!std::isfinite(x_w_nm) || !std::isfinite(z_w_nm)) return;
    const ImVec2 p = pen.at({x_w_nm, state.tip_pos_w_nm.y(), z_w_nm});
    const bool upright = out_x != 0;
    const float at = upright ? p.x : p.y;
    const float low = upright ? pen.left() : pen.top();
    const float high = upright ? pen.right() : pen.bottom();
    if (!(at > low && at < high)) return;
    const float from = upright ? pen.top() : pen.left();
    const float to = upright ? pen.bottom() : pen.right();
    const auto place = [&](float along, float across) {
      return upright ? ImVec2{at + across, along} : ImVec2{along, at + across};
    };
    pen.line(place(from, 0), place(to, 0), palette::kWarning, 2, 0.9f);
    const float out = 9 * s * (upright ? out_x : out_y);
    for (float along = from; along < to; along += 12 * s)
      pen.line(place(along, out), place(along + 9 * s, 0), palette::kWarning, 1, 0.6f);
  };
  const Vec3& tip = state.tip_pos_w_nm;
  wall(state.wall_min_w_nm.x(), tip.z(), -1, 0);
  wall(state.wall_max_w_nm.x(), tip.z(), 1, 0);
  wall(tip.x(), state.wall_min_w_nm.z(), 0, 1);
  wall(tip.x(), state.wall_max_w_nm.z(), 0, -1);
}

struct BesideBar {
  ImVec2 where;
  ImVec2 anchor;
};

/// Where words of this size stand clear of a bar from a to b: above its middle, or to the right of a steep one. Along
/// half the words the bar comes nearer by its slope.
BesideBar beside_bar(ImVec2 a, ImVec2 b, ImVec2 size, float clear) {
  const ImVec2 middle{0.5f * (a.x + b.x), 0.5f * (a.y + b.y)};
  const float dx = std::abs(b.x - a.x);
  const float dy = std::abs(b.y - a.y);
  if (dx >= dy) {
    const float rise = dx > 0 ? dy / dx * 0.5f * std::min(size.x, dx) : 0;
    return {{middle.x, middle.y - rise - clear}, {0.5f, 1}};
  }
  const float reach = dx / dy * 0.5f * std::min(size.y, dy);
  return {{middle.x + reach + clear, middle.y}, {0, 0.5f}};
}

/// The boxes that a bar from a to b lies in, piece by piece: the one box round a slanted bar would be mostly empty.
std::array<std::pair<ImVec2, ImVec2>, 16> pieces_of_bar(ImVec2 a, ImVec2 b, float half_wide) {
  std::array<std::pair<ImVec2, ImVec2>, 16> pieces;
  const auto at = [&](std::size_t k) {
    const float part = static_cast<float>(k) / static_cast<float>(pieces.size());
    return ImVec2{a.x + part * (b.x - a.x), a.y + part * (b.y - a.y)};
  };
  for (std::size_t i = 0; i < pieces.size(); ++i) {
    const ImVec2 from = at(i);
    const ImVec2 to = at(i + 1);
    pieces[i] = {{std::min(from.x, to.x) - half_wide, std::min(from.y, to.y) - half_wide},
                 {std::max(from.x, to.x) + half_wide, std::max(from.y, to.y) + half_wide}};
  }
  return pieces;
}

// A bar that lies on the ground along its front edge, so that perspective shortens both alike: at one end of the edge, or at
// the other where words stand in its way.
void draw_ground_bar(const Gui& gui, const Pen& pen, const SceneState& state, const Camera& camera) {
  const auto& ground = state.ground;
  const double length = view_model::nice_step(0.25 * ground.width_nm());
  const std::string words = view_model::length_text(length);
  const ImVec2 size = text_size(gui.small(), words.c_str());
  const double y = camera.direction().y() < 0 ? ground.min_w_nm().y() + 0.05 * ground.depth_nm()
                                              : ground.max_w_nm().y() - 0.05 * ground.depth_nm();
  const auto place = [&](double at) { return pen.at({at, y, ground.height_w_nm(at, y)}); };
  const double inset = 0.05 * ground.width_nm();
  for (const double x : {ground.min_w_nm().x() + inset, ground.max_w_nm().x() - inset - length}) {
    const ImVec2 a = place(x);
    const ImVec2 b = place(x + length);
    const auto pieces = pieces_of_bar(a, b, 3 * pen.s());
    const auto is_free = [&](const auto& piece) { return gui.words().is_free(piece.first, piece.second); };
    if (!std::all_of(pieces.begin(), pieces.end(), is_free)) continue;
    // A bar whose length is not written says nothing.
    const BesideBar beside = beside_bar(a, b, size, 4 * pen.s());
    if (!pen.text(beside.where, words, palette::kText, beside.anchor)) continue;
    pen.line(a, b, palette::kBackground, 5, 0.7f);
    pen.line(a, b, palette::kText, 3);
    for (const auto& [from, to] : pieces) gui.words().take(from, to);
    return;
  }
}

void draw_height_legend(const Gui& gui, const Pen& pen, const SceneState& state, double exaggeration) {
  const float s = pen.s();
  const bool scan = state.ground.is_scan();
  const double low = scan ? state.ground.min_w_nm().z() : state.touched.lowest_nm();
  const double high = scan ? state.ground.max_w_nm().z() : state.touched.highest_nm();
  if (!scan && state.touched.points_w_nm().empty()) return;
  ImVec2 from{pen.left() + 14 * s, pen.top() + 78 * s};
  const float wide = 11 * s;
  const float high_px = 84 * s;
  // In a narrow picture the badges take more rows.
  const auto free = [&] {
    return gui.words().is_free({from.x, from.y - 20 * s}, {from.x + wide, from.y + high_px});
  };
  for (int i = 0; i < 20 && !free(); ++i) from.y += 4 * s;
  constexpr int kBands = 48;
  for (int i = 0; i < kBands; ++i) {
    const auto colour = view_model::height_colour(1 - (i + 0.5) / kBands);
    pen.list()->AddRectFilled({from.x, from.y + high_px * static_cast<float>(i) / kBands},
                              {from.x + wide, from.y + high_px * static_cast<float>(i + 1) / kBands},
                              ink(colour));
  }
  gui.words().take(from, {from.x + wide, from.y + high_px});
  const float x = from.x + wide + 5 * s;
  pen.text({x, from.y}, fmt::format("{:.1f} nm", high), palette::kText, {0, 0.3f});
  pen.text({x, from.y + high_px}, fmt::format("{:.1f} nm", low), palette::kText, {0, 0.7f});
  pen.text({from.x, from.y - 6 * s}, scan ? "height" : "height where touched", palette::kQuiet, {0, 1});
  if (exaggeration != 1)
    pen.text({from.x, from.y + high_px + 8 * s}, fmt::format("heights × {:g}", exaggeration),
             palette::kQuiet);
}

// What the picture does not show, or shows otherwise than it is: in the lower corners.
void draw_foot_notes(const Gui& gui, const Pen& pen, const ViewFacts& facts, const SceneState& state) {
  const float s = pen.s();
  const auto note = [&](const std::string& words, const palette::Rgb& colour) {
    return Pen::Line{words, colour, gui.small()};
  };
  std::vector<Pen::Line> lines;
  if (!facts.surface_doubt.empty()) lines.push_back(note(facts.surface_doubt, palette::kWarning));
  if (!facts.scene.note.empty()) lines.push_back(note(facts.scene.note, palette::kWarning));
  if (!state.ground.is_scan() && state.touched.points_w_nm().empty()) {
    lines.push_back(note("no scan given (--surface):", palette::kQuiet));
    lines.push_back(note("the plane at the touch height", palette::kQuiet));
  }
  lines.push_back(note(fmt::format("lever's bend × {:g}", state.lever_exaggeration), palette::kQuiet));
  lines.push_back(note(fmt::format("full cone: {:g} nN", state.force_full_nn), palette::kQuiet));
  pen.block(lines, {{pen.left() + 8 * s, pen.bottom()}});
}

palette::Rgb force_colour(const Vec3& force_w_nn, bool old) {
  if (old) return palette::kQuiet;
  return force_w_nn.z() >= 0 ? palette::kRepulsion : palette::kAttraction;
}

std::string age_text(double silent_s) {
  return fmt::format("{:.1f} s old", silent_s);
}

}  // namespace

void draw_overview_text(const Gui& gui, const ViewFacts& facts, const SceneState& state,
                        const view_model::LiveSession& live, const Camera& camera, const SceneFrame& frame,
                        const Area& area) {
  const Pen pen(gui, camera, frame, area);
  const float s = pen.s();
  draw_height_legend(gui, pen, state, frame.exaggeration);
  draw_foot_notes(gui, pen, facts, state);
  draw_target(pen, state);
  const ImVec2 tip = pen.at(state.tip_pos_w_nm);
  const double silent_s = view_model::silent_s(live.now());
  std::vector<Pen::Line> lines;
  if (silent_s > 0) lines.push_back({age_text(silent_s), palette::kWarning, gui.text()});
  lines.push_back({view_model::force_size_text(state.force_w_nn),
                   force_colour(state.force_w_nn, silent_s > 0), gui.text()});
  lines.push_back({view_model::force_parts_text(state.force_w_nn),
                   force_colour(state.force_w_nn, silent_s > 0), gui.small()});
  lines.push_back({"gap " + view_model::length_text(live.gap_nm()), palette::kText, gui.small()});
  // Before the first reply nothing is known of the tip.
  if (live.now().reply_sequence == 0) lines = {{"no reply yet", palette::kQuiet, gui.text()}};
  pen.block(lines, {{tip.x + 22 * s, tip.y - 8 * s},
                    {tip.x + 22 * s, tip.y + 24 * s},
                    {tip.x - 150 * s, tip.y - 8 * s},
                    {tip.x - 150 * s, tip.y + 24 * s}});
  if (state.particle.radius_nm > 0 && !state.part) {
    const ImVec2 foot = pen.at(state.particle.pos_w_nm - state.particle.radius_nm * Vec3::UnitZ());
    pen.block({{view_model::particle_text(state.particle.status), palette::kParticle, gui.small()}},
              {{foot.x - 40 * s, foot.y + 6 * s}, {foot.x - 40 * s, foot.y + 24 * s}});
  }
  draw_ground_bar(gui, pen, state, camera);
  draw_axes(pen, state, camera);
}

void draw_measurement(const Gui& gui, const view_model::Profile& profile, const Camera& camera,
                      const SceneFrame& frame, const Area& area) {
  const Pen pen(gui, camera, frame, area);
  const float s = pen.s();
  ImVec2 before = pen.at(profile.from_w_nm());
  for (const auto& point : profile.points) {
    const ImVec2 here = pen.at(point.pos_w_nm);
    pen.line(before, here, palette::kTarget, 2);
    before = here;
  }
  for (const auto& [pos_w_nm, name] :
       {std::pair{profile.from_w_nm(), "A"}, std::pair{profile.to_w_nm(), "B"}}) {
    const ImVec2 p = pen.at(pos_w_nm);
    pen.list()->AddCircleFilled(p, 4 * s, ink(palette::kTarget));
    pen.block({{name, palette::kTarget, gui.text()}},
              {{p.x - 12 * s, p.y - 20 * s}, {p.x + 6 * s, p.y + 4 * s}});
  }
}

void draw_close_up_text(const Gui& gui, const SceneState& state, const view_model::LiveSession& live,
                        const Camera& camera, const SceneFrame& frame, const Area& area) {
  const Pen pen(gui, camera, frame, area);
  const float s = pen.s();
  pen.list()->AddLine({pen.left(), pen.top()}, {pen.left(), pen.bottom()}, ink(palette::kEdge), 2 * s);
  const bool wide = static_cast<float>(area.width_px) > 300 * s;
  std::vector<Pen::Line> title = {
      {wide ? "Section through the tip along x" : "Section along x", palette::kText, gui.text()}};
  // As few lines as there is room for.
  for (const auto& [words, parting] : {std::pair<std::string, const char*>{"true proportions", ""},
                                       {state.tip.words, "; "},
                                       {state.tip.doubt, " "}}) {
    if (words.empty()) continue;
    const std::string joined = title.back().words + parting + words;
    const float room = static_cast<float>(area.width_px) - 20 * s;
    if (title.size() > 1 && text_size(gui.small(), joined.c_str()).x < room) {
      title.back().words = joined;
    } else {
      title.push_back({words, palette::kQuiet, gui.small()});
    }
  }
  pen.block(title, {{pen.left() + 10 * s, pen.top() + 8 * s}});
  // The picture is orthographic: a bar across it is true everywhere.
  const double per_px = camera.nm_per_pixel(area.height_px);
  const double length = view_model::nice_step(0.35 * per_px * area.width_px);
  const auto long_px = static_cast<float>(length / per_px);
  const ImVec2 end{pen.right() - 14 * s, pen.bottom() - 16 * s};
  pen.line({end.x - long_px, end.y}, end, palette::kBackground, 5, 0.7f);
  pen.line({end.x - long_px, end.y}, end, palette::kText, 3);
  pen.text({end.x - 0.5f * long_px, end.y - 5 * s}, view_model::length_text(length), palette::kText,
           {0.5f, 1});
  if (live.now().reply_sequence == 0) return;
  draw_walls(pen, state);
  draw_target(pen, state);
  // The gap as an engineer would draw it: beside what it measures, between two thin lines.
  Vec3 foot = state.tip_pos_w_nm;
  foot.z() = state.ground.height_w_nm(foot.x(), foot.y());
  const ImVec2 a = pen.at(state.tip_pos_w_nm);
  const ImVec2 b = pen.at(foot);
  const float x = a.x + 0.24f * static_cast<float>(area.width_px);
  for (const ImVec2& p : {a, b}) pen.line({p.x, p.y}, {x + 4 * s, p.y}, palette::kText, 1, 0.55f);
  pen.line({x, a.y}, {x, b.y}, palette::kText, 1.4f);
  for (const ImVec2& p : {a, b}) pen.list()->AddCircleFilled({x, p.y}, 2.5f * s, ink(palette::kText));
  const std::string gap = view_model::length_text(live.gap_nm());
  const ImVec2 gap_size = text_size(gui.text(), gap.c_str());
  const float y = 0.5f * (a.y + b.y) - 0.5f * gap_size.y;
  pen.block({{gap, palette::kText, gui.text()}}, {{x + 9 * s, y}, {x - 9 * s - gap_size.x, y}});
  const float above = state.force_w_nn.z() >= 0 ? -1.0f : 1.0f;
  const auto cone_px = static_cast<float>(
      kConeHalves * std::min(state.force_w_nn.norm() / state.force_full_nn, 1.0) * 0.5 * area.height_px);
  const double silent_s = view_model::silent_s(live.now());
  const palette::Rgb colour = force_colour(state.force_w_nn, silent_s > 0);
  std::vector<Pen::Line> lines;
  if (silent_s > 0) lines.push_back({age_text(silent_s), palette::kWarning, gui.text()});
  lines.push_back({view_model::force_size_text(state.force_w_nn), colour, gui.text()});
  lines.push_back({view_model::force_parts_text(state.force_w_nn), colour, gui.small()});
  float widest = 0;
  for (const Pen::Line& line : lines) widest = std::max(widest, text_size(line.font, line.words.c_str()).x);
  const float high = (silent_s > 0 ? 44 : 28) * s;
  pen.block(lines, {{a.x - 0.5f * widest, a.y + above * (cone_px + 6 * s) - (above < 0 ? high : 0)}});
}

namespace {

using view_model::Badge;

// A model is blue, a real sample red, none grey; all else has the colour of how grave it is.
palette::Rgb colour_of(const Badge& badge) {
  const bool source = badge.kind == Badge::Kind::kSource;
  if (!source || badge.mood != Mood::kCalm) return colour_of(badge.mood);
  return badge.word == "SIM" ? palette::kAttraction : palette::kQuiet;
}

}  // namespace

void draw_banner(const Gui& gui, const ViewFacts& facts, const view_model::LiveSession& live,
                 const Area& area, bool ended, station::TwinState twin, const std::string& practice) {
  ImDrawList* const list = ImGui::GetBackgroundDrawList();
  const float s = gui.scale();
  const float left = static_cast<float>(area.x_px) + 10 * s;
  const float right = static_cast<float>(area.x_px + area.width_px) - 6 * s;
  float x = left;
  float y = static_cast<float>(area.y_px) + 8 * s;
  const auto pill = [&](const std::string& words, const palette::Rgb& colour, bool filled) {
    const std::string cut = cut_to(gui.text(), words, right - left - 18 * s);
    const char* const text = cut.c_str();
    const ImVec2 size = text_size(gui.text(), text);
    if (x > left && x + size.x + 18 * s > right) {
      x = left;
      y += size.y + 12 * s;
    }
    const ImVec2 from{x, y};
    const ImVec2 to{x + size.x + 18 * s, y + size.y + 8 * s};
    gui.words().take(from, to);
    list->AddRectFilled(from, to, filled ? ink(colour) : ink(palette::kPanel, 0.9f), 6 * s);
    if (!filled) list->AddRect(from, to, ink(colour), 6 * s, 0, 1.5f * s);
    list->AddText(gui.text(), gui.text()->FontSize, {x + 9 * s, y + 4 * s},
                  filled ? ink(palette::kBackground) : ink(colour), text);
    x = to.x + 8 * s;
  };
  view_model::SessionInputs inputs{live.now(), live.origin(), facts.give_up_s, ended};
  inputs.played = !facts.played.empty();
  inputs.twin = twin;
  for (const Badge& badge : view_model::session_banner(inputs).badges)
    pill(badge.word, colour_of(badge), badge.filled);
  if (!practice.empty()) pill(practice, palette::kWarning, true);
  // What does not fit into the row goes under it, and is cut there.
  if (x + text_size(gui.text(), facts.scene_name.c_str()).x > right && x > left) {
    x = left;
    y += 28 * s;
  }
  const std::string about = cut_to(gui.text(), facts.scene_name, right - x);
  const ImVec2 from{x + 2 * s, y + 4 * s};
  gui.words().take(from, {from.x + text_size(gui.text(), about.c_str()).x, from.y + gui.text()->FontSize});
  list->AddText(gui.text(), gui.text()->FontSize, from, ink(palette::kText), about.c_str());
}

}  // namespace telenano::viewer
