#pragma once

#include <imgui.h>

#include <algorithm>
#include <array>
#include <map>
#include <set>
#include <string>
#include <utility>
#include <vector>

/// What the last frame says, read back from the triangles that were handed to the driver: no label of the
/// product's is asked where it believes to be.
namespace telenano::viewer {

struct Glyph {
  float x0 = 0, y0 = 0, x1 = 0, y1 = 0;  ///< of the ink, after clipping, pixels
  ImU32 colour = 0;
  ImWchar letter = 0;
  /// At the right edge of what it is drawn in, or at the left by more than the hook of a j.
  bool cut = false;
  bool cut_below = false;
};

/// Every letter of the last frame in the order of drawing but those in `ignored` (a dark edge round others).
/// Blanks leave no ink. A letter is two triangles over a rectangle of the fonts' texture.
inline std::vector<Glyph> drawn_glyphs(ImU32 ignored) {
  const ImFontAtlas& atlas = *ImGui::GetIO().Fonts;
  std::map<std::pair<float, float>, ImWchar> letters;
  for (const ImFont* font : atlas.Fonts)
    for (const ImFontGlyph& g : font->Glyphs) letters[{g.U0, g.V0}] = static_cast<ImWchar>(g.Codepoint);
  std::vector<Glyph> glyphs;
  const ImDrawData* const data = ImGui::GetDrawData();
  for (int l = 0; l < data->CmdListsCount; ++l) {
    const ImDrawList& list = *data->CmdLists[l];
    for (const ImDrawCmd& cmd : list.CmdBuffer) {
      for (unsigned i = 0; i + 6 <= cmd.ElemCount; i += 3) {
        const ImDrawIdx* const index = list.IdxBuffer.Data + cmd.IdxOffset + i;
        const auto first = index[0];
        if (index[1] != first + 1 || index[2] != first + 2 || index[3] != first || index[4] != first + 2 ||
            index[5] != first + 3)
          continue;
        const ImDrawVert* const v = list.VtxBuffer.Data + cmd.VtxOffset + first;
        const auto letter = letters.find({v[0].uv.x, v[0].uv.y});
        if (letter == letters.end() || v[0].uv.y == v[2].uv.y || v[0].col == ignored) continue;
        Glyph g{std::max(v[0].pos.x, cmd.ClipRect.x),
                std::max(v[0].pos.y, cmd.ClipRect.y),
                std::min(v[2].pos.x, cmd.ClipRect.z),
                std::min(v[2].pos.y, cmd.ClipRect.w),
                v[0].col,
                letter->second,
                v[2].pos.x > cmd.ClipRect.z + 0.5f ||
                    cmd.ClipRect.x - v[0].pos.x > 0.4f * (v[2].pos.x - v[0].pos.x),
                v[2].pos.y > cmd.ClipRect.w + 0.5f};
        if (g.x1 > g.x0 && g.y1 > g.y0) glyphs.push_back(g);
      }
    }
  }
  return glyphs;
}

struct Triangle {
  std::array<ImVec2, 3> at;
};

/// What else has this colour in the last frame: lines and boxes. Their places in the fonts' texture are no letter's.
inline std::vector<Triangle> drawn_triangles(ImU32 colour) {
  std::set<std::pair<float, float>> corners_of_letters;
  for (const ImFont* font : ImGui::GetIO().Fonts->Fonts)
    for (const ImFontGlyph& g : font->Glyphs)
      corners_of_letters.insert({{g.U0, g.V0}, {g.U1, g.V0}, {g.U1, g.V1}, {g.U0, g.V1}});
  std::vector<Triangle> triangles;
  const ImDrawData* const data = ImGui::GetDrawData();
  for (int l = 0; l < data->CmdListsCount; ++l) {
    const ImDrawList& list = *data->CmdLists[l];
    for (const ImDrawCmd& cmd : list.CmdBuffer) {
      for (unsigned i = 0; i + 3 <= cmd.ElemCount; i += 3) {
        Triangle triangle;
        bool is_other = true;
        for (unsigned k = 0; k < 3; ++k) {
          const ImDrawIdx index = list.IdxBuffer.Data[cmd.IdxOffset + i + k];
          const ImDrawVert& v = list.VtxBuffer.Data[cmd.VtxOffset + index];
          triangle.at[k] = v.pos;
          is_other = is_other && v.col == colour && !corners_of_letters.contains({v.uv.x, v.uv.y});
        }
        if (is_other) triangles.push_back(triangle);
      }
    }
  }
  return triangles;
}

/// Have they a point in common? Two convex shapes that have not are parted by an edge of one of them.
inline bool meet(const Triangle& triangle, const Glyph& g) {
  const std::array<ImVec2, 4> box = {{{g.x0, g.y0}, {g.x1, g.y0}, {g.x1, g.y1}, {g.x0, g.y1}}};
  const auto parts = [&](ImVec2 normal) {
    const auto range = [&](const auto& points) {
      std::pair<float, float> least_most{1e9f, -1e9f};
      for (const ImVec2& p : points) {
        const float along = p.x * normal.x + p.y * normal.y;
        least_most = {std::min(least_most.first, along), std::max(least_most.second, along)};
      }
      return least_most;
    };
    const auto mine = range(triangle.at);
    const auto its = range(box);
    return mine.second <= its.first || its.second <= mine.first;
  };
  if (parts({1, 0}) || parts({0, 1})) return false;
  for (std::size_t k = 0; k < 3; ++k) {
    const ImVec2& a = triangle.at[k];
    const ImVec2& b = triangle.at[(k + 1) % 3];
    if (parts({b.y - a.y, a.x - b.x})) return false;
  }
  return true;
}

/// All letters, without blanks, in the order of drawing; what is not ASCII is a '?'.
inline std::string drawn_text(const std::vector<Glyph>& glyphs) {
  std::string text;
  for (const Glyph& g : glyphs) text.push_back(g.letter < 128 ? static_cast<char>(g.letter) : '?');
  return text;
}

/// Letters that lie on others: "x, y: word / word" for the first few, empty where there are none. Neighbours
/// in a word may touch by less than a pixel.
inline std::string overlaps(const std::vector<Glyph>& glyphs) {
  constexpr float kTouch_px = 1.2f;
  const auto around = [&](std::size_t i) {
    std::string word;
    const std::size_t from = i < 8 ? 0 : i - 8;
    for (std::size_t k = from; k < std::min(i + 9, glyphs.size()); ++k)
      if (std::abs(glyphs[k].y1 - glyphs[i].y1) < 8)
        word.push_back(glyphs[k].letter < 128 ? static_cast<char>(glyphs[k].letter) : '?');
    return word;
  };
  std::string found;
  int told = 0;
  for (std::size_t a = 0; a < glyphs.size(); ++a) {
    for (std::size_t b = a + 1; b < glyphs.size(); ++b) {
      const float wide = std::min(glyphs[a].x1, glyphs[b].x1) - std::max(glyphs[a].x0, glyphs[b].x0);
      const float high = std::min(glyphs[a].y1, glyphs[b].y1) - std::max(glyphs[a].y0, glyphs[b].y0);
      if (wide < kTouch_px || high < kTouch_px) continue;
      // A letter's neighbour in its own word: the next one to the right of it.
      if (b == a + 1 && glyphs[b].x0 > glyphs[a].x0 + 2 && wide < 3) continue;
      if (++told > 6) return found + "…";
      found += std::to_string(static_cast<int>(glyphs[a].x0)) + ", " +
               std::to_string(static_cast<int>(glyphs[a].y0)) + ": " + around(a) + " / " + around(b) + "\n";
    }
  }
  return found;
}

}  // namespace telenano::viewer
