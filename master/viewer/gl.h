#pragma once

#include <epoxy/gl.h>

#include <Eigen/Core>
#include <cstddef>
#include <span>
#include <string>
#include <vector>

#include "telenano/common/base/vec3.h"
#include "telenano/master/view_model/camera.h"
#include "telenano/master/view_model/colour_map.h"

/// OpenGL 3.3 core objects that free themselves. A context must be current wherever they are used.
namespace telenano::viewer {

/// A vertex and a fragment shader. Throws RunError with the driver's words when they do not compile.
class Program {
 public:
  Program(const char* name, const char* vertex_source, const char* fragment_source);
  ~Program();
  Program(const Program&) = delete;
  Program& operator=(const Program&) = delete;

  void use() const noexcept { glUseProgram(id_); }
  void set(const char* uniform, int value) const noexcept;
  void set(const char* uniform, double value) const noexcept;
  void set(const char* uniform, double x, double y) const noexcept;
  void set(const char* uniform, const Vec3& value) const noexcept;
  void set(const char* uniform, const view_model::Rgb& value) const noexcept;
  void set(const char* uniform, const view_model::Mat4& value) const noexcept;

 private:
  GLuint id_ = 0;
};

/// Corners, and triangles of them, on the card.
class Buffer {
 public:
  /// Floats of each attribute, in the order of their locations.
  explicit Buffer(std::vector<int> attributes);
  ~Buffer();
  Buffer(const Buffer&) = delete;
  Buffer& operator=(const Buffer&) = delete;

  void set(std::span<const float> corners, std::span<const std::uint32_t> indices, GLenum usage);
  /// Corners alone, drawn in their order.
  void set(std::span<const float> corners, GLenum usage) { set(corners, {}, usage); }
  void draw(GLenum mode) const noexcept;

 private:
  GLuint array_ = 0;
  GLuint corners_ = 0;
  GLuint indices_ = 0;
  int stride_ = 0;  // floats
  GLsizei count_ = 0;
  bool indexed_ = false;
};

class Texture {
 public:
  Texture();
  ~Texture();
  Texture(const Texture&) = delete;
  Texture& operator=(const Texture&) = delete;

  void set_rgb8(int width, int height, std::span<const unsigned char> texels);
  void set_rgb32f(int width, int height, std::span<const float> texels);
  void bind(int unit) const noexcept;

 private:
  GLuint id_ = 0;
};

/// Where a picture without a window is drawn: colour and depth, with `samples` places a pixel where the
/// driver has them.
class Canvas {
 public:
  Canvas(int width_px, int height_px, int samples);
  ~Canvas();
  Canvas(const Canvas&) = delete;
  Canvas& operator=(const Canvas&) = delete;

  void bind() const noexcept;
  /// RGB, rows from top to bottom.
  std::vector<unsigned char> read_rgb() const;

 private:
  int width_px_;
  int height_px_;
  GLuint drawn_ = 0;
  GLuint resolved_ = 0;
  GLuint buffers_[3] = {};
};

}  // namespace telenano::viewer
