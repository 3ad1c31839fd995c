#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <vector>

namespace fathom::io {

// The bytes of a regular file of 1 to `max_bytes`. Throws InputError for an absent, unreadable, empty or
// larger one; `what` says what it should be ("a mission.toml").
[[nodiscard]] std::vector<std::uint8_t> readFileBytes(const std::filesystem::path& path,
                                                      std::size_t max_bytes, const char* what);

}  // namespace fathom::io
