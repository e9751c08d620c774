#include "telenano/master/viewer/offscreen.h"

#include <epoxy/egl.h>

#include "telenano/common/base/error.h"

namespace telenano::viewer {
namespace {

[[noreturn]] void refuse(const char* what) {
  throw RunError(std::string("no picture without a display: ") + what +
                 "; apt-get install libegl1 libgl1-mesa-dri, or run under xvfb-run with --view");
}

}  // namespace

OffscreenContext::OffscreenContext() {
  if (!epoxy_has_egl()) refuse("libEGL is not installed");
  if (!epoxy_has_egl_extension(EGL_NO_DISPLAY, "EGL_MESA_platform_surfaceless") ||
      !epoxy_has_egl_extension(EGL_NO_DISPLAY, "EGL_EXT_platform_base"))
    refuse("this machine's EGL cannot draw without a surface");
  EGLDisplay display = eglGetPlatformDisplayEXT(EGL_PLATFORM_SURFACELESS_MESA, EGL_DEFAULT_DISPLAY, nullptr);
  EGLint major = 0;
  EGLint minor = 0;
  if (display == EGL_NO_DISPLAY || !eglInitialize(display, &major, &minor)) refuse("EGL does not start");
  display_ = display;
  eglBindAPI(EGL_OPENGL_API);
  constexpr EGLint kConfig[] = {EGL_SURFACE_TYPE, EGL_PBUFFER_BIT, EGL_RENDERABLE_TYPE, EGL_OPENGL_BIT,
                                EGL_NONE};
  EGLConfig config = nullptr;
  EGLint configs = 0;
  if (!eglChooseConfig(display, kConfig, &config, 1, &configs) || configs < 1) refuse("EGL has no OpenGL");
  constexpr EGLint kContext[] = {EGL_CONTEXT_MAJOR_VERSION,
                                 3,
                                 EGL_CONTEXT_MINOR_VERSION,
                                 3,
                                 EGL_CONTEXT_OPENGL_PROFILE_MASK,
                                 EGL_CONTEXT_OPENGL_CORE_PROFILE_BIT,
                                 EGL_NONE};
  EGLContext context = eglCreateContext(display, config, EGL_NO_CONTEXT, kContext);
  if (context == EGL_NO_CONTEXT || !eglMakeCurrent(display, EGL_NO_SURFACE, EGL_NO_SURFACE, context)) {
    eglTerminate(display);
    refuse("the driver has no OpenGL 3.3");
  }
  context_ = context;
}

OffscreenContext::~OffscreenContext() {
  eglMakeCurrent(display_, EGL_NO_SURFACE, EGL_NO_SURFACE, EGL_NO_CONTEXT);
  eglDestroyContext(display_, context_);
  eglTerminate(display_);
}

}  // namespace telenano::viewer
