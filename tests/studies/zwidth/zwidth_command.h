#pragma once

namespace CLI {
class App;
}

namespace telenano::studies {

/// `zwidth`: the stiffest virtual walls a haptic display can show, after Colgate and Brown.
void add_zwidth_command(CLI::App& app);
/// `scaling`: the region of the force scaling factor, after Kim and Sitti, as published and exact.
void add_scaling_command(CLI::App& app);

}  // namespace telenano::studies
