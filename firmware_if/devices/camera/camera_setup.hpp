#pragma once

// Included by sources of this folder only: nothing else sees Aravis and GLib.
extern "C" {
#include <arv.h>
}

#include <cstdint>
#include <memory>
#include <string>

#include "firmware_if/devices/camera/camera_config.hpp"

namespace fathom::io {

// GLib's and Aravis' objects and errors as C++ values.
struct Unref {
  void operator()(void* object) const noexcept { g_object_unref(object); }
};
template <typename T>
using GObjectPtr = std::unique_ptr<T, Unref>;

[[nodiscard]] inline std::string stringOf(const char* value) {
  return value == nullptr ? "" : value;
}

// The GError** of one call after another; the first failure's text is kept.
class AravisError {
 public:
  AravisError() = default;
  ~AravisError() { g_clear_error(&error_); }
  AravisError(const AravisError&) = delete;
  AravisError& operator=(const AravisError&) = delete;

  // For a call: an error before it is dropped.
  [[nodiscard]] GError** out() {
    g_clear_error(&error_);
    return &error_;
  }
  [[nodiscard]] bool failed() const { return error_ != nullptr; }
  [[nodiscard]] bool timedOut() const {
    return g_error_matches(error_, ARV_DEVICE_ERROR, ARV_DEVICE_ERROR_TIMEOUT) != FALSE;
  }
  [[nodiscard]] std::string text() const { return error_ == nullptr ? "no reason given" : error_->message; }

 private:
  GError* error_ = nullptr;
};

// What a camera said of itself after it was set up.
struct CameraIdentity {
  std::string vendor, model, serial, address;
  double exposure_s = 0;  // 0: unknown
  double gain_db = 0;
  int packet_size = 0;            // [bytes]
  std::size_t payload_bytes = 0;  // of a frame
};

// Opens the camera of the configuration, takes control of it and writes every setting. Null, with the reason
// in `why`, when it is absent, controlled by another program or refuses a setting. Takes up to about three
// seconds.
[[nodiscard]] GObjectPtr<ArvCamera> openCamera(const CameraConfig& config, CameraIdentity& identity,
                                               std::string& why);

}  // namespace fathom::io
