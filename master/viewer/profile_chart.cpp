#include "telenano/master/viewer/profile_chart.h"

#include <fmt/format.h>

#include <algorithm>
#include <string>
#include <vector>

#include "telenano/master/view_model/status_text.h"

namespace telenano::viewer {

void draw_profile(const Gui& gui, const ChartBox& box, const view_model::Profile& profile) {
  using view_model::length_text;
  const float s = gui.scale();
  ImDrawList* const list = ImGui::GetWindowDrawList();
  const ImFont* const font = gui.small();
  list->AddRectFilled(box.from, box.to, ink(palette::kBackground), 4 * s);
  const auto write = [&](ImVec2 at, const palette::Rgb& colour, const std::string& text) {
    const ImVec2 size = font->CalcTextSizeA(font->FontSize, 1e9f, 0, text.c_str());
    const bool inside = at.x + size.x <= box.to.x && at.y + size.y <= box.to.y;
    if (inside && gui.words().take_if_free(at, {at.x + size.x, at.y + size.y}))
      list->AddText(font, font->FontSize, at, ink(colour), text.c_str());
  };
  const float line = font->FontSize + 2 * s;
  ImVec2 p{box.from.x + 8 * s, box.from.y + 5 * s};
  write(p, palette::kQuiet, "Profile A to B  (D: as CSV)");
  p.y += line;
  write(p, palette::kText,
        fmt::format("{} apart, height {}{}", length_text(profile.level_nm()),
                    profile.rise_nm() < 0 ? "" : "+", length_text(profile.rise_nm())));
  p.y += line;
  const double relief_nm = profile.highest_w_nm - profile.lowest_w_nm;
  write(p, palette::kText, fmt::format("lowest to highest {}", length_text(relief_nm)));
  const ImVec2 from{box.from.x + 10 * s, p.y + line + 2 * s};
  const ImVec2 to{box.to.x - 10 * s, box.to.y - 8 * s};
  if (to.y - from.y < 6 * s) return;
  // At least a picometre high, so that a plane is a straight line.
  const double span = std::max(relief_nm, 1e-3);
  const double length = std::max(profile.level_nm(), 1e-9);
  const auto at = [&](const view_model::Profile::Point& point) {
    const auto x = static_cast<float>(point.along_nm / length);
    const auto y = static_cast<float>((point.pos_w_nm.z() - profile.lowest_w_nm) / span);
    return ImVec2{from.x + x * (to.x - from.x), to.y - y * (to.y - from.y)};
  };
  std::vector<ImVec2> way;
  way.reserve(profile.points.size());
  for (const auto& point : profile.points) way.push_back(at(point));
  list->AddPolyline(way.data(), static_cast<int>(way.size()), ink(palette::kTarget), ImDrawFlags_None,
                    1.6f * s);
  for (const ImVec2& end : {way.front(), way.back()})
    list->AddCircleFilled(end, 3 * s, ink(palette::kTarget));
}

}  // namespace telenano::viewer
