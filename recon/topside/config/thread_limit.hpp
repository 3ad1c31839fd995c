#pragma once

#include <oneapi/tbb/global_control.h>
#include <oneapi/tbb/info.h>

#include "recon/topside/config/topside_config.hpp"

namespace fathom::topside {

[[nodiscard]] inline int threadsOf(const TopsideConfig& config) {
  return config.threads > 0 ? config.threads : oneapi::tbb::info::default_concurrency();
}

// No more threads than run.threads as long as it lives.
class ThreadLimit {
 public:
  explicit ThreadLimit(const TopsideConfig& config)
      : limit_(oneapi::tbb::global_control::max_allowed_parallelism,
               static_cast<std::size_t>(threadsOf(config))) {}

 private:
  oneapi::tbb::global_control limit_;
};

}  // namespace fathom::topside
