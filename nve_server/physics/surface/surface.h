#pragma once

/// The sample's surface, frame W: x to the right, y up the image, z out of the sample, nm.
namespace telenano::physics {

/// Seam: the sample as a height field without overhangs. What the tip feels of it are the fields of its apex
/// (contact_fields.h); the heights are for who looks at it, and for the borders of the workspace.
class Surface {
 public:
  virtual ~Surface() = default;

  virtual double height_nm(double x_nm, double y_nm) const noexcept = 0;
  virtual double lowest_nm() const noexcept = 0;
  virtual double highest_nm() const noexcept = 0;
  /// The plane z = 0, where the law of the contact alone says the force.
  virtual bool is_flat() const noexcept = 0;
};

}  // namespace telenano::physics
