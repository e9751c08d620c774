#include "telenano/master/view_model/meshes.h"

#include <Eigen/Geometry>
#include <cmath>
#include <numbers>

namespace telenano::view_model {
namespace {

constexpr double kTurn = 2 * std::numbers::pi;

std::uint32_t add(Mesh& mesh, const Vec3& pos, const Vec3& normal) {
  const auto f = [](double v) { return static_cast<float>(v); };
  mesh.corners.push_back(
      {{f(pos.x()), f(pos.y()), f(pos.z())}, {f(normal.x()), f(normal.y()), f(normal.z())}});
  return static_cast<std::uint32_t>(mesh.corners.size() - 1);
}

void add_triangle(Mesh& mesh, std::uint32_t a, std::uint32_t b, std::uint32_t c) {
  mesh.triangles.insert(mesh.triangles.end(), {a, b, c});
}

void add_quad(Mesh& mesh, const Vec3& a, const Vec3& b, const Vec3& c, const Vec3& d) {
  const Vec3 normal = (b - a).cross(c - a).normalized();
  const std::uint32_t first = add(mesh, a, normal);
  add(mesh, b, normal);
  add(mesh, c, normal);
  add(mesh, d, normal);
  add_triangle(mesh, first, first + 1, first + 2);
  add_triangle(mesh, first, first + 2, first + 3);
}

}  // namespace

namespace {

Mesh sphere_part(int rings, int sectors, double turn) {
  Mesh mesh;
  for (int ring = 0; ring <= rings; ++ring) {
    const double polar = std::numbers::pi * ring / rings;
    for (int sector = 0; sector <= sectors; ++sector) {
      const double around = turn * sector / sectors;
      const Vec3 p(std::sin(polar) * std::cos(around), std::sin(polar) * std::sin(around), std::cos(polar));
      add(mesh, p, p);
    }
  }
  const auto at = [sectors](int ring, int sector) {
    return static_cast<std::uint32_t>(ring * (sectors + 1) + sector);
  };
  for (int ring = 0; ring < rings; ++ring) {
    for (int sector = 0; sector < sectors; ++sector) {
      if (ring > 0) add_triangle(mesh, at(ring, sector), at(ring + 1, sector), at(ring, sector + 1));
      if (ring + 1 < rings)
        add_triangle(mesh, at(ring, sector + 1), at(ring + 1, sector), at(ring + 1, sector + 1));
    }
  }
  return mesh;
}

}  // namespace

Mesh unit_sphere(int rings, int sectors) {
  return sphere_part(rings, sectors, kTurn);
}

Mesh half_sphere(int rings, int sectors) {
  return sphere_part(rings, sectors, 0.5 * kTurn);
}

Mesh unit_cone(int sectors) {
  Mesh mesh = frustum(1, 0, sectors);
  const std::uint32_t centre = add(mesh, Vec3::Zero(), -Vec3::UnitZ());
  for (int sector = 0; sector <= sectors; ++sector) {
    const double around = kTurn * sector / sectors;
    add(mesh, {std::cos(around), std::sin(around), 0}, -Vec3::UnitZ());
  }
  for (int sector = 0; sector < sectors; ++sector) {
    const auto rim = centre + 1 + static_cast<std::uint32_t>(sector);
    add_triangle(mesh, centre, rim + 1, rim);
  }
  return mesh;
}

Mesh frustum(double bottom_radius, double top_radius, int sectors) {
  Mesh mesh;
  for (int sector = 0; sector <= sectors; ++sector) {
    const double around = kTurn * sector / sectors;
    const Vec3 out(std::cos(around), std::sin(around), 0);
    const Vec3 normal = (out + (bottom_radius - top_radius) * Vec3::UnitZ()).normalized();
    add(mesh, bottom_radius * out, normal);
    add(mesh, top_radius * out + Vec3::UnitZ(), normal);
  }
  for (int sector = 0; sector < sectors; ++sector) {
    const auto i = static_cast<std::uint32_t>(2 * sector);
    add_triangle(mesh, i, i + 2, i + 1);
    add_triangle(mesh, i + 1, i + 2, i + 3);
  }
  return mesh;
}

Mesh bent_lever(double length, double width, double thickness, double deflection, int segments) {
  Mesh mesh;
  const auto cut = [&](int i) {
    const double s = 1 - static_cast<double>(i) / segments;  // 1 at the tip's end
    return Vec3(0, length * (1 - s), deflection * (lever_bend(s) - 1));
  };
  const Vec3 across = 0.5 * width * Vec3::UnitX();
  const Vec3 down = -thickness * Vec3::UnitZ();
  for (int i = 0; i < segments; ++i) {
    const Vec3 a = cut(i);
    const Vec3 b = cut(i + 1);
    add_quad(mesh, a - across, a + across, b + across, b - across);                              // top
    add_quad(mesh, b - across + down, b + across + down, a + across + down, a - across + down);  // bottom
    add_quad(mesh, a + across, a + across + down, b + across + down, b + across);
    add_quad(mesh, b - across, b - across + down, a - across + down, a - across);
  }
  const Vec3 tip = cut(0);
  add_quad(mesh, tip - across, tip - across + down, tip + across + down, tip + across);
  return mesh;
}

}  // namespace telenano::view_model
