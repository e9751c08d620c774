#include "telenano/master/viewer/keys.h"

#define GLFW_INCLUDE_NONE
#include <GLFW/glfw3.h>
#include <imgui_internal.h>

#include <array>
#include <utility>

namespace telenano::viewer {

#if IMGUI_VERSION_NUM >= 18900
namespace {

constexpr std::array kOthers = {
    std::pair{GLFW_KEY_SPACE, ImGuiKey_Space},
    std::pair{GLFW_KEY_APOSTROPHE, ImGuiKey_Apostrophe},
    std::pair{GLFW_KEY_COMMA, ImGuiKey_Comma},
    std::pair{GLFW_KEY_MINUS, ImGuiKey_Minus},
    std::pair{GLFW_KEY_PERIOD, ImGuiKey_Period},
    std::pair{GLFW_KEY_SLASH, ImGuiKey_Slash},
    std::pair{GLFW_KEY_SEMICOLON, ImGuiKey_Semicolon},
    std::pair{GLFW_KEY_EQUAL, ImGuiKey_Equal},
    std::pair{GLFW_KEY_LEFT_BRACKET, ImGuiKey_LeftBracket},
    std::pair{GLFW_KEY_BACKSLASH, ImGuiKey_Backslash},
    std::pair{GLFW_KEY_RIGHT_BRACKET, ImGuiKey_RightBracket},
    std::pair{GLFW_KEY_GRAVE_ACCENT, ImGuiKey_GraveAccent},
    std::pair{GLFW_KEY_ESCAPE, ImGuiKey_Escape},
    std::pair{GLFW_KEY_ENTER, ImGuiKey_Enter},
    std::pair{GLFW_KEY_TAB, ImGuiKey_Tab},
    std::pair{GLFW_KEY_BACKSPACE, ImGuiKey_Backspace},
    std::pair{GLFW_KEY_INSERT, ImGuiKey_Insert},
    std::pair{GLFW_KEY_DELETE, ImGuiKey_Delete},
    std::pair{GLFW_KEY_RIGHT, ImGuiKey_RightArrow},
    std::pair{GLFW_KEY_LEFT, ImGuiKey_LeftArrow},
    std::pair{GLFW_KEY_DOWN, ImGuiKey_DownArrow},
    std::pair{GLFW_KEY_UP, ImGuiKey_UpArrow},
    std::pair{GLFW_KEY_PAGE_UP, ImGuiKey_PageUp},
    std::pair{GLFW_KEY_PAGE_DOWN, ImGuiKey_PageDown},
    std::pair{GLFW_KEY_HOME, ImGuiKey_Home},
    std::pair{GLFW_KEY_END, ImGuiKey_End},
    std::pair{GLFW_KEY_CAPS_LOCK, ImGuiKey_CapsLock},
    std::pair{GLFW_KEY_SCROLL_LOCK, ImGuiKey_ScrollLock},
    std::pair{GLFW_KEY_NUM_LOCK, ImGuiKey_NumLock},
    std::pair{GLFW_KEY_PRINT_SCREEN, ImGuiKey_PrintScreen},
    std::pair{GLFW_KEY_PAUSE, ImGuiKey_Pause},
    std::pair{GLFW_KEY_KP_DECIMAL, ImGuiKey_KeypadDecimal},
    std::pair{GLFW_KEY_KP_DIVIDE, ImGuiKey_KeypadDivide},
    std::pair{GLFW_KEY_KP_MULTIPLY, ImGuiKey_KeypadMultiply},
    std::pair{GLFW_KEY_KP_SUBTRACT, ImGuiKey_KeypadSubtract},
    std::pair{GLFW_KEY_KP_ADD, ImGuiKey_KeypadAdd},
    std::pair{GLFW_KEY_KP_ENTER, ImGuiKey_KeypadEnter},
    std::pair{GLFW_KEY_KP_EQUAL, ImGuiKey_KeypadEqual},
    std::pair{GLFW_KEY_LEFT_SHIFT, ImGuiKey_LeftShift},
    std::pair{GLFW_KEY_LEFT_CONTROL, ImGuiKey_LeftCtrl},
    std::pair{GLFW_KEY_LEFT_ALT, ImGuiKey_LeftAlt},
    std::pair{GLFW_KEY_LEFT_SUPER, ImGuiKey_LeftSuper},
    std::pair{GLFW_KEY_RIGHT_SHIFT, ImGuiKey_RightShift},
    std::pair{GLFW_KEY_RIGHT_CONTROL, ImGuiKey_RightCtrl},
    std::pair{GLFW_KEY_RIGHT_ALT, ImGuiKey_RightAlt},
    std::pair{GLFW_KEY_RIGHT_SUPER, ImGuiKey_RightSuper},
    std::pair{GLFW_KEY_MENU, ImGuiKey_Menu},
};

ImGuiKey named(int key) {
  const auto of = [key](int first, int last, ImGuiKey to) {
    return key >= first && key <= last ? static_cast<ImGuiKey>(to + key - first) : ImGuiKey_None;
  };
  for (const ImGuiKey one :
       {of(GLFW_KEY_A, GLFW_KEY_Z, ImGuiKey_A), of(GLFW_KEY_0, GLFW_KEY_9, ImGuiKey_0),
        of(GLFW_KEY_F1, GLFW_KEY_F24, ImGuiKey_F1), of(GLFW_KEY_KP_0, GLFW_KEY_KP_9, ImGuiKey_Keypad0)})
    if (one != ImGuiKey_None) return one;
  for (const auto& [ours, theirs] : kOthers)
    if (key == ours) return theirs;
  return ImGuiKey_None;
}

}  // namespace

// By itself it would keep what came after a letter or a click for a later frame, a STOP too.
void begin_keys() {
  ImGui::GetIO().ConfigInputTrickleEventQueue = false;
}

void set_key(int key, bool down) {
  if (const ImGuiKey one = named(key); one != ImGuiKey_None) ImGui::GetIO().AddKeyEvent(one, down);
}

void set_modifiers(int mods) {
  ImGuiIO& io = ImGui::GetIO();
  io.AddKeyEvent(ImGuiMod_Ctrl, (mods & GLFW_MOD_CONTROL) != 0);
  io.AddKeyEvent(ImGuiMod_Shift, (mods & GLFW_MOD_SHIFT) != 0);
  io.AddKeyEvent(ImGuiMod_Alt, (mods & GLFW_MOD_ALT) != 0);
  io.AddKeyEvent(ImGuiMod_Super, (mods & GLFW_MOD_SUPER) != 0);
}

void set_mouse_button(int button, bool down) {
  ImGui::GetIO().AddMouseButtonEvent(button, down);
}

bool key_pressed(int key, bool again) {
  const ImGuiKey one = named(key);
  return one != ImGuiKey_None && ImGui::IsKeyPressed(one, again);
}

bool key_down(int key) {
  const ImGuiKey one = named(key);
  return one != ImGuiKey_None && ImGui::IsKeyDown(one);
}

// From 1.89 on Enter presses what has the focus, as Space does.
void press_nothing() {
  ImGuiContext& context = *ImGui::GetCurrentContext();
  context.NavActivateId = context.NavActivateDownId = context.NavActivatePressedId = 0;
}
#else
// As its input from a window does; a picture without a window has none.
void begin_keys() {
  ImGuiIO& io = ImGui::GetIO();
  io.KeyMap[ImGuiKey_Tab] = GLFW_KEY_TAB;
  io.KeyMap[ImGuiKey_Space] = GLFW_KEY_SPACE;
  io.KeyMap[ImGuiKey_Enter] = GLFW_KEY_ENTER;
  io.KeyMap[ImGuiKey_UpArrow] = GLFW_KEY_UP;
}

void set_key(int key, bool down) {
  ImGui::GetIO().KeysDown[key] = down;
}

void set_modifiers(int mods) {
  ImGuiIO& io = ImGui::GetIO();
  io.KeyCtrl = (mods & GLFW_MOD_CONTROL) != 0;
  io.KeyShift = (mods & GLFW_MOD_SHIFT) != 0;
  io.KeyAlt = (mods & GLFW_MOD_ALT) != 0;
  io.KeySuper = (mods & GLFW_MOD_SUPER) != 0;
}

void set_mouse_button(int button, bool down) {
  ImGui::GetIO().MouseDown[button] = down;
}

bool key_pressed(int key, bool again) {
  return ImGui::IsKeyPressed(key, again);
}

bool key_down(int key) {
  return ImGui::IsKeyDown(key);
}

void press_nothing() {}
#endif

}  // namespace telenano::viewer
