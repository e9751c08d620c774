#include "telenano/master/viewer/guide_box.h"

#include <algorithm>

namespace telenano::viewer {

void draw_guide_box(const Gui& gui, const std::string& title, const std::string& words, double part,
                    const Area& area) {
  const float s = gui.scale();
  const float room = 8 * s;
  ImVec2 from{static_cast<float>(area.x_px) + 10 * s, static_cast<float>(area.y_px) + 58 * s};
  const float wide = std::min(static_cast<float>(area.width_px) - 20 * s, 420 * s) - 2 * room;
  if (wide < 100 * s) return;  // not even its longest word
  const ImFont* const small = gui.small();
  const ImFont* const text = gui.text();
  const ImVec2 title_size = small->CalcTextSizeA(small->FontSize, 1e9f, wide, title.c_str());
  const ImVec2 words_size = text->CalcTextSizeA(text->FontSize, 1e9f, wide, words.c_str());
  const ImVec2 size{wide + 2 * room, title_size.y + words_size.y + 3 * room + 3 * s};
  // Under the badges, where they take more rows; in a picture without room for it, nowhere.
  const auto end = static_cast<float>(area.y_px + area.height_px);
  while (!gui.words().is_free(from, {from.x + size.x, from.y + size.y}) && from.y + size.y < end)
    from.y += 4 * s;
  const ImVec2 to{from.x + size.x, from.y + size.y};
  if (to.y > end || !gui.words().take_if_free(from, to)) return;
  ImDrawList* const list = ImGui::GetBackgroundDrawList();
  list->AddRectFilled(from, to, ink(palette::kRaised, 0.94f), 5 * s);
  list->AddRect(from, to, ink(palette::kGood), 5 * s, 0, 1.5f * s);
  ImVec2 p{from.x + room, from.y + room};
  list->AddText(small, small->FontSize, p, ink(palette::kQuiet), title.c_str(), nullptr, wide);
  p.y += title_size.y + 0.5f * room;
  list->AddText(text, text->FontSize, p, ink(palette::kText), words.c_str(), nullptr, wide);
  const float y = to.y - room;
  const auto done = static_cast<float>(std::clamp(part, 0.0, 1.0));
  list->AddRectFilled({from.x + room, y}, {to.x - room, y + 3 * s}, ink(palette::kEdge), 1.5f * s);
  list->AddRectFilled({from.x + room, y}, {from.x + room + done * wide, y + 3 * s}, ink(palette::kGood),
                      1.5f * s);
}

}  // namespace telenano::viewer
