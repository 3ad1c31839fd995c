#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>

#include "sim/sea/renderer.hpp"

namespace fathom::sim {

// Renders one image (Renderer::render) and writes it as TIFF with 8 or 16 bit samples.
void photograph(const Renderer& renderer, const SE3& T_nav_body, double time_s, CameraSide side,
                std::uint64_t noise_seed, const std::filesystem::path& file,
                const PhotoConditions& conditions = {});

// Runs `work` on `threads` threads of oneTBB; 0: as many as the machine has.
void withThreads(int threads, const std::function<void()>& work);

// Calls make(i) for i in 0..count-1 in parallel; `progress` after each, one call at a time.
void forEachPair(std::size_t count, const std::function<void(std::size_t done, std::size_t total)>& progress,
                 const std::function<void(std::size_t)>& make);

}  // namespace fathom::sim
