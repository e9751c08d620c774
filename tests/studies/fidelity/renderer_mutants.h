#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <string_view>

#include "telenano/common/control/scaling.h"
#include "telenano/common/control/station_method.h"
#include "telenano/nve_server/slave/slave.h"

namespace telenano::studies::fidelity {

/// Renderers that are wrong on purpose: nobody would be hurt by them, and nobody would learn what the sample
/// is like.
enum class WrongRenderer : std::uint8_t {
  kNone,        ///< the sample itself, stepped in the station: what the others are made of
  kZero,        ///< no force
  kHalf,        ///< half of it
  kLate,        ///< 100 ms late
  kNoAdhesion,  ///< never pulls down
  kNoFriction,  ///< nothing along the ground: on level ground that is friction and what ploughing takes
  kTilted,      ///< turned by 10° about y
  kSoft,        ///< 0.3 times the stiffness: the tip goes in 0.3 times as deep
  kLow,         ///< the ground 3 nm too low
  kFirstModel,  ///< the plane of the first contact, for ever
  kReversed     ///< x the wrong way round
};
inline constexpr std::array<WrongRenderer, 10> kWrongRenderers = {
    WrongRenderer::kZero,       WrongRenderer::kHalf,    WrongRenderer::kLate, WrongRenderer::kNoAdhesion,
    WrongRenderer::kNoFriction, WrongRenderer::kTilted,  WrongRenderer::kSoft, WrongRenderer::kLow,
    WrongRenderer::kFirstModel, WrongRenderer::kReversed};
std::string_view wrong_renderer_name(WrongRenderer wrong) noexcept;

/// A method that steps `sample` itself at each tick's command, wrong as it is told to be: no delay, no account,
/// no clamp.
std::unique_ptr<control::StationMethod> local_sample(WrongRenderer wrong, const control::Scaling& scaling,
                                                     std::unique_ptr<slave::Slave> sample);

/// The product's `model`, whose account and clamp hold, with what it shows made wrong likewise. `ground_w_nm`:
/// height of the surface.
std::unique_ptr<control::StationMethod> wrong_model(WrongRenderer wrong, double ground_w_nm);

}  // namespace telenano::studies::fidelity
