#include "telenano/master/viewer/gui.h"

#include <backends/imgui_impl_opengl3.h>

#include <array>
#include <filesystem>

#include "telenano/common/base/error.h"
#include "telenano/master/viewer/keys.h"

namespace telenano::viewer {
namespace {

constexpr const char* kRegular = "/usr/share/fonts/truetype/dejavu/DejaVuSans.ttf";
constexpr const char* kBold = "/usr/share/fonts/truetype/dejavu/DejaVuSans-Bold.ttf";
// Latin, Greek, superscripts and dashes, arrows, mathematics.
constexpr std::array<ImWchar, 13> kGlyphs = {0x20,   0xFF,   0x370,  0x3FF,  0x2010, 0x2094, 0x1D62,
                                             0x1D6A, 0x2190, 0x2199, 0x2200, 0x22FF, 0};

void set_style(float scale) {
  using namespace palette;
  ImGuiStyle& style = ImGui::GetStyle();
  style = ImGuiStyle();
  ImGui::StyleColorsDark();
  style.WindowRounding = 0;
  style.WindowBorderSize = 0;
  style.FrameRounding = 4;
  style.GrabRounding = 4;
  style.WindowPadding = {12, 10};
  style.FramePadding = {8, 4};
  style.ItemSpacing = {8, 6};
  style.ScrollbarSize = 10;
  style.ScaleAllSizes(scale);
  const auto set = [&style](ImGuiCol what, const Rgb& c, float alpha = 1) {
    style.Colors[what] = vec4(c, alpha);
  };
  set(ImGuiCol_Text, kText);
  set(ImGuiCol_TextDisabled, kQuiet);
  set(ImGuiCol_WindowBg, kPanel);
  set(ImGuiCol_PopupBg, kRaised);
  set(ImGuiCol_Border, kEdge);
  set(ImGuiCol_FrameBg, kRaised);
  set(ImGuiCol_FrameBgHovered, kEdge);
  set(ImGuiCol_FrameBgActive, kEdge);
  set(ImGuiCol_Button, kRaised);
  set(ImGuiCol_ButtonHovered, kEdge);
  set(ImGuiCol_ButtonActive, kQuiet);
  set(ImGuiCol_Header, kEdge);
  set(ImGuiCol_HeaderHovered, kEdge);
  set(ImGuiCol_HeaderActive, kQuiet);
  set(ImGuiCol_SliderGrab, kQuiet);
  set(ImGuiCol_SliderGrabActive, kText);
  set(ImGuiCol_CheckMark, kGood);
  set(ImGuiCol_Separator, kEdge);
}

}  // namespace

Gui::Gui(float scale) : scale_(scale) {
  IMGUI_CHECKVERSION();
  ImGui::CreateContext();
  ImGuiIO& io = ImGui::GetIO();
  io.IniFilename = nullptr;  // nothing is kept between sessions: the same picture every time
  io.LogFilename = nullptr;
  begin_keys();
  set_style(scale);
  load_fonts();
  if (!ImGui_ImplOpenGL3_Init("#version 330 core"))
    throw RunError("viewer: Dear ImGui does not start on this driver");
}

void Gui::set_scale(float scale) {
  if (scale == scale_) return;
  scale_ = scale;
  set_style(scale);
  ImGui::GetIO().Fonts->Clear();
  load_fonts();
  ImGui_ImplOpenGL3_DestroyFontsTexture();
  ImGui_ImplOpenGL3_CreateFontsTexture();
}

void Gui::load_fonts() {
  ImGuiIO& io = ImGui::GetIO();
  const bool found = std::filesystem::exists(kRegular);
  const bool bold = std::filesystem::exists(kBold);
  const auto font = [&](const char* path, float size_px) {
    if (found) return io.Fonts->AddFontFromFileTTF(path, size_px * scale_, nullptr, kGlyphs.data());
    ImFontConfig config;
    config.SizePixels = size_px * scale_;
    return io.Fonts->AddFontDefault(&config);
  };
  // Whole numbers: Dear ImGui rounds others down from 1.90 on.
  text_ = font(kRegular, 14);
  small_ = font(kRegular, 11);
  large_ = font(bold ? kBold : kRegular, 19);
  has_greek_ = found;
}

Gui::~Gui() {
  ImGui_ImplOpenGL3_Shutdown();
  ImGui::DestroyContext();
}

}  // namespace telenano::viewer
