#pragma once

#include <filesystem>
#include <vector>

#include "realtime/kernel/threads/arming.hpp"

namespace fathom::rt {

// What the machine's set-up does to the wake-ups of the hard tier, from /proc and /sys under `root`: kernel,
// throttling, clock source, isolation of hard_cpus, interrupts that may come on them, and frequency
// governors. None is required; a check that is not met says what to set. Sources: the kernel's documentation,
// admin-guide/kernel-parameters and admin-guide/pm/cpufreq.
[[nodiscard]] std::vector<ArmingCheck> checkMachine(const RealtimeConfig& config,
                                                    const std::filesystem::path& root = "/");

}  // namespace fathom::rt
