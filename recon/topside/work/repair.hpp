#pragma once

#include <cstdio>
#include <filesystem>
#include <system_error>

#include "recon/topside/work/stage_store.hpp"

namespace fathom::topside {

// Calls `body`; work that turns out to be damaged while it is in use is removed, and `body` called again to
// make it again.
template <typename Body>
auto withRepair(const Body& body) {
  constexpr int kAttempts = 3;
  for (int attempt = 1;; ++attempt) {
    try {
      return body();
    } catch (const DamagedWork& damage) {
      if (attempt == kAttempts) throw;
      std::fprintf(stderr, "%s; it will be made again\n", damage.what());
      std::error_code ignored;
      std::filesystem::remove(damage.path(), ignored);
    }
  }
}

}  // namespace fathom::topside
