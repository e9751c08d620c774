#pragma once

#include <cstdint>
#include <memory>

#include "telenano/nve_server/scene/scene.h"

namespace telenano::slave {

/// A number of what this very program makes of a scene: FNV-1a, 64 bit, over every bit that a slave gives out
/// along a fixed path. Two programs that give the same number for a scene step it alike, as far as the path
/// tells: another compiler, library or forgotten version of the physics gives another. The path: down to the
/// sample and 3 nm into it, across and back under load, up and off, over the rim of the coupling's speed, and
/// where there is a particle, across that. 1140 steps at most.
///
/// It protects against mistakes, not against malice: who answers with the right number may still send wrong
/// forces. Throws what the making of a slave throws.
std::uint64_t canonical_motion_hash(const std::shared_ptr<const scene::Scene>& scene);

}  // namespace telenano::slave
