#pragma once

#include <memory>

#include "firmware_if/devices/camera/camera_source.hpp"
#include "firmware_if/devices/sample_source.hpp"
#include "realtime/kernel/frame_port.hpp"

namespace fathom::test {

// Devices that give what no device should, while the part that they belong to is PartFault::kCorrupt:
// impossible values and times; noise for pixels, and times; bytes of no frame.
[[nodiscard]] std::unique_ptr<io::SampleSource> spoilt(std::unique_ptr<io::SampleSource> source);
[[nodiscard]] std::unique_ptr<io::CameraSource> spoilt(std::unique_ptr<io::CameraSource> camera);
// Takes frames and gives none but those.
[[nodiscard]] std::unique_ptr<FramePort> spoiltModem();

}  // namespace fathom::test
