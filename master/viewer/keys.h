#pragma once

#include <imgui.h>

namespace telenano::viewer {

/// What Dear ImGui is told of keys and mouse buttons, and asked of keys: the one place that knows how each of its
/// versions does that. A key has GLFW's number, GLFW_KEY_...: where it lies, whatever is printed on it.

/// Once for a context.
void begin_keys();
/// For the frame to come, and until told otherwise.
void set_key(int key, bool down);
/// GLFW_MOD_... of those that are held.
void set_modifiers(int mods);
void set_mouse_button(int button, bool down);

/// In this frame. `again`: also as often as a held key repeats.
bool key_pressed(int key, bool again = false);
bool key_down(int key);
/// The widget that has the focus does not hear Enter in this frame.
void press_nothing();

/// Of ImGuiIO::KeyMods.
#if IMGUI_VERSION_NUM >= 18900
inline constexpr int kCtrlModifier = ImGuiMod_Ctrl;
#else
inline constexpr int kCtrlModifier = ImGuiKeyModFlags_Ctrl;
#endif

}  // namespace telenano::viewer
