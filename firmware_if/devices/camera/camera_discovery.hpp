#pragma once

#include <string>
#include <vector>

namespace fathom::io {

// A GigE Vision camera that answered.
struct FoundCamera {
  std::string vendor, model, serial;
  std::string address;  // IP
  std::string id;       // as Aravis opens it
};

// Asks on every network interface, or on one; takes about a second. In the order of their serial numbers.
// Several threads may ask: one after the other.
[[nodiscard]] std::vector<FoundCamera> findCameras(const std::string& interface = "");

// Whether `wanted` (serial, "Vendor-serial", stored name or IP address) names this one.
[[nodiscard]] bool isCamera(const FoundCamera& camera, const std::string& wanted);

// Whether the text is an IPv4 address.
[[nodiscard]] bool isIpAddress(const std::string& text);

}  // namespace fathom::io
