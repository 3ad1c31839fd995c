#pragma once

#include <cstdint>
#include <filesystem>

#include "sim/sea/renderer.hpp"

namespace fathom::sim {

// Renders one image (Renderer::render) and writes it as TIFF, of 8 or 16 bit samples as the sensor has.
void photograph(const Renderer& renderer, const SE3& T_nav_body, double time_s, CameraSide side,
                std::uint64_t noise_seed, const std::filesystem::path& file, const Moment& moment = {});

}  // namespace fathom::sim
