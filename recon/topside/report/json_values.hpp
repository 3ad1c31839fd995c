#pragma once

#include <Eigen/Core>
#include <nlohmann/json.hpp>

namespace fathom::topside {

// A vector as three numbers of a report; written as null where one is not finite.
[[nodiscard]] inline nlohmann::ordered_json jsonOf(const Eigen::Vector3d& v) {
  return {v.x(), v.y(), v.z()};
}

}  // namespace fathom::topside
