#pragma once

namespace telenano::viewer {

/// An OpenGL 3.3 core context without window or display server (EGL, surfaceless), current in the thread that
/// made it. Throws RunError with what to do when this machine has none.
class OffscreenContext {
 public:
  OffscreenContext();
  ~OffscreenContext();
  OffscreenContext(const OffscreenContext&) = delete;
  OffscreenContext& operator=(const OffscreenContext&) = delete;

 private:
  void* display_ = nullptr;
  void* context_ = nullptr;
};

}  // namespace telenano::viewer
