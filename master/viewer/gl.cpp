#include "telenano/master/viewer/gl.h"

#include <algorithm>
#include <array>
#include <cstdint>
#include <numeric>

#include "telenano/common/base/error.h"

namespace telenano::viewer {
namespace {

GLuint compile(const char* name, GLenum kind, const char* source) {
  const GLuint shader = glCreateShader(kind);
  glShaderSource(shader, 1, &source, nullptr);
  glCompileShader(shader);
  GLint good = 0;
  glGetShaderiv(shader, GL_COMPILE_STATUS, &good);
  if (good != 0) return shader;
  std::array<char, 1024> log{};
  glGetShaderInfoLog(shader, log.size(), nullptr, log.data());
  glDeleteShader(shader);
  throw RunError(std::string("viewer: the driver does not compile shader '") + name + "': " + log.data());
}

}  // namespace

Program::Program(const char* name, const char* vertex_source, const char* fragment_source) {
  const GLuint vertex = compile(name, GL_VERTEX_SHADER, vertex_source);
  const GLuint fragment = compile(name, GL_FRAGMENT_SHADER, fragment_source);
  id_ = glCreateProgram();
  glAttachShader(id_, vertex);
  glAttachShader(id_, fragment);
  glLinkProgram(id_);
  glDeleteShader(vertex);
  glDeleteShader(fragment);
  GLint good = 0;
  glGetProgramiv(id_, GL_LINK_STATUS, &good);
  if (good != 0) return;
  std::array<char, 1024> log{};
  glGetProgramInfoLog(id_, log.size(), nullptr, log.data());
  glDeleteProgram(id_);
  throw RunError(std::string("viewer: the driver does not link shader '") + name + "': " + log.data());
}

Program::~Program() {
  glDeleteProgram(id_);
}

void Program::set(const char* uniform, int value) const noexcept {
  glUniform1i(glGetUniformLocation(id_, uniform), value);
}
void Program::set(const char* uniform, double value) const noexcept {
  glUniform1f(glGetUniformLocation(id_, uniform), static_cast<float>(value));
}
void Program::set(const char* uniform, double x, double y) const noexcept {
  glUniform2f(glGetUniformLocation(id_, uniform), static_cast<float>(x), static_cast<float>(y));
}
void Program::set(const char* uniform, const Vec3& value) const noexcept {
  const Eigen::Vector3f v = value.cast<float>();
  glUniform3fv(glGetUniformLocation(id_, uniform), 1, v.data());
}
void Program::set(const char* uniform, const view_model::Rgb& value) const noexcept {
  glUniform3f(glGetUniformLocation(id_, uniform), value.r, value.g, value.b);
}
void Program::set(const char* uniform, const view_model::Mat4& value) const noexcept {
  const Eigen::Matrix4f m = value.cast<float>();  // column-major, as OpenGL wants it
  glUniformMatrix4fv(glGetUniformLocation(id_, uniform), 1, GL_FALSE, m.data());
}

Buffer::Buffer(std::vector<int> attributes)
    : stride_(std::accumulate(attributes.begin(), attributes.end(), 0)) {
  glGenVertexArrays(1, &array_);
  glGenBuffers(1, &corners_);
  glGenBuffers(1, &indices_);
  glBindVertexArray(array_);
  glBindBuffer(GL_ARRAY_BUFFER, corners_);
  glBindBuffer(GL_ELEMENT_ARRAY_BUFFER, indices_);
  std::size_t offset = 0;
  for (std::size_t i = 0; i < attributes.size(); ++i) {
    const auto location = static_cast<GLuint>(i);
    glEnableVertexAttribArray(location);
    glVertexAttribPointer(location, attributes[i], GL_FLOAT, GL_FALSE,
                          static_cast<GLsizei>(stride_ * sizeof(float)),
                          reinterpret_cast<const void*>(offset * sizeof(float)));
    offset += static_cast<std::size_t>(attributes[i]);
  }
  glBindVertexArray(0);
}

Buffer::~Buffer() {
  glDeleteBuffers(1, &indices_);
  glDeleteBuffers(1, &corners_);
  glDeleteVertexArrays(1, &array_);
}

void Buffer::set(std::span<const float> corners, std::span<const std::uint32_t> indices, GLenum usage) {
  glBindVertexArray(array_);
  glBindBuffer(GL_ARRAY_BUFFER, corners_);
  glBufferData(GL_ARRAY_BUFFER, static_cast<GLsizeiptr>(corners.size_bytes()), corners.data(), usage);
  indexed_ = !indices.empty();
  if (indexed_) {
    glBufferData(GL_ELEMENT_ARRAY_BUFFER, static_cast<GLsizeiptr>(indices.size_bytes()), indices.data(),
                 usage);
  }
  count_ =
      static_cast<GLsizei>(indexed_ ? indices.size() : corners.size() / static_cast<std::size_t>(stride_));
  glBindVertexArray(0);
}

void Buffer::draw(GLenum mode) const noexcept {
  if (count_ == 0) return;
  glBindVertexArray(array_);
  if (indexed_) {
    glDrawElements(mode, count_, GL_UNSIGNED_INT, nullptr);
  } else {
    glDrawArrays(mode, 0, count_);
  }
  glBindVertexArray(0);
}

Texture::Texture() {
  glGenTextures(1, &id_);
}
Texture::~Texture() {
  glDeleteTextures(1, &id_);
}

void Texture::bind(int unit) const noexcept {
  glActiveTexture(GL_TEXTURE0 + static_cast<GLenum>(unit));
  glBindTexture(GL_TEXTURE_2D, id_);
}

void Texture::set_rgb8(int width, int height, std::span<const unsigned char> texels) {
  bind(0);
  glPixelStorei(GL_UNPACK_ALIGNMENT, 1);
  glTexImage2D(GL_TEXTURE_2D, 0, GL_RGB8, width, height, 0, GL_RGB, GL_UNSIGNED_BYTE, texels.data());
  glTexParameteri(GL_TEXTURE_2D, GL_TEXTURE_MIN_FILTER, GL_LINEAR);
  glTexParameteri(GL_TEXTURE_2D, GL_TEXTURE_MAG_FILTER, GL_LINEAR);
  glTexParameteri(GL_TEXTURE_2D, GL_TEXTURE_WRAP_S, GL_CLAMP_TO_EDGE);
  glTexParameteri(GL_TEXTURE_2D, GL_TEXTURE_WRAP_T, GL_CLAMP_TO_EDGE);
}

void Texture::set_rgb32f(int width, int height, std::span<const float> texels) {
  bind(0);
  glPixelStorei(GL_UNPACK_ALIGNMENT, 4);
  glTexImage2D(GL_TEXTURE_2D, 0, GL_RGBA32F, width, height, 0, GL_RGB, GL_FLOAT, texels.data());
  glTexParameteri(GL_TEXTURE_2D, GL_TEXTURE_MIN_FILTER, GL_LINEAR);
  glTexParameteri(GL_TEXTURE_2D, GL_TEXTURE_MAG_FILTER, GL_LINEAR);
  glTexParameteri(GL_TEXTURE_2D, GL_TEXTURE_WRAP_S, GL_CLAMP_TO_EDGE);
  glTexParameteri(GL_TEXTURE_2D, GL_TEXTURE_WRAP_T, GL_CLAMP_TO_EDGE);
}

Canvas::Canvas(int width_px, int height_px, int samples) : width_px_(width_px), height_px_(height_px) {
  GLint most = 0;
  glGetIntegerv(GL_MAX_SAMPLES, &most);
  const GLsizei places = std::clamp(samples, 0, static_cast<int>(most));
  glGenFramebuffers(1, &drawn_);
  glGenFramebuffers(1, &resolved_);
  glGenRenderbuffers(3, buffers_);
  const auto store = [&](GLuint buffer, GLsizei at, GLenum format) {
    glBindRenderbuffer(GL_RENDERBUFFER, buffer);
    glRenderbufferStorageMultisample(GL_RENDERBUFFER, at, format, width_px_, height_px_);
  };
  store(buffers_[0], places, GL_RGBA8);
  store(buffers_[1], places, GL_DEPTH_COMPONENT24);
  store(buffers_[2], 0, GL_RGBA8);
  glBindFramebuffer(GL_FRAMEBUFFER, resolved_);
  glFramebufferRenderbuffer(GL_FRAMEBUFFER, GL_COLOR_ATTACHMENT0, GL_RENDERBUFFER, buffers_[2]);
  glBindFramebuffer(GL_FRAMEBUFFER, drawn_);
  glFramebufferRenderbuffer(GL_FRAMEBUFFER, GL_COLOR_ATTACHMENT0, GL_RENDERBUFFER, buffers_[0]);
  glFramebufferRenderbuffer(GL_FRAMEBUFFER, GL_DEPTH_ATTACHMENT, GL_RENDERBUFFER, buffers_[1]);
  if (glCheckFramebufferStatus(GL_FRAMEBUFFER) != GL_FRAMEBUFFER_COMPLETE)
    throw RunError("viewer: the driver gives no canvas of " + std::to_string(width_px) + " x " +
                   std::to_string(height_px) + " pixels");
}

Canvas::~Canvas() {
  glDeleteFramebuffers(1, &drawn_);
  glDeleteFramebuffers(1, &resolved_);
  glDeleteRenderbuffers(3, buffers_);
}

void Canvas::bind() const noexcept {
  glBindFramebuffer(GL_FRAMEBUFFER, drawn_);
}

std::vector<unsigned char> Canvas::read_rgb() const {
  glBindFramebuffer(GL_READ_FRAMEBUFFER, drawn_);
  glBindFramebuffer(GL_DRAW_FRAMEBUFFER, resolved_);
  glBlitFramebuffer(0, 0, width_px_, height_px_, 0, 0, width_px_, height_px_, GL_COLOR_BUFFER_BIT,
                    GL_NEAREST);
  glBindFramebuffer(GL_FRAMEBUFFER, resolved_);
  const auto row_bytes = static_cast<std::size_t>(3 * width_px_);
  std::vector<unsigned char> upside_down(row_bytes * static_cast<std::size_t>(height_px_));
  glPixelStorei(GL_PACK_ALIGNMENT, 1);
  glReadPixels(0, 0, width_px_, height_px_, GL_RGB, GL_UNSIGNED_BYTE, upside_down.data());
  glBindFramebuffer(GL_FRAMEBUFFER, drawn_);
  std::vector<unsigned char> rgb(upside_down.size());
  for (int row = 0; row < height_px_; ++row) {
    const auto from = static_cast<std::ptrdiff_t>(row_bytes) * (height_px_ - 1 - row);
    std::copy_n(upside_down.begin() + from, row_bytes,
                rgb.begin() + static_cast<std::ptrdiff_t>(row_bytes) * row);
  }
  return rgb;
}

}  // namespace telenano::viewer
