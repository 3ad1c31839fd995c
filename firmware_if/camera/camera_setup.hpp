#pragma once

#include <cstdint>
#include <string>

#include "firmware_if/camera/aravis_handles.hpp"
#include "firmware_if/camera/camera_config.hpp"

namespace fathom::io {

// What a camera said of itself after it was set up.
struct CameraIdentity {
  std::string vendor, model, serial, address;
  double exposure_s = 0;  // 0: it does not tell
  double gain_db = 0;
  int packet_size = 0;            // [bytes]
  std::size_t payload_bytes = 0;  // of a frame
};

// Opens the camera of the configuration, takes control of it and writes every setting. Null, with the reason
// in `why`, when it is absent, controlled by another program or lacks something that is asked. Takes up to
// about three seconds.
[[nodiscard]] GObjectPtr<ArvCamera> openCamera(const CameraConfig& config, CameraIdentity& identity,
                                               std::string& why);

}  // namespace fathom::io
