#pragma once

// GLib's and Aravis' objects and errors as C++ values; included by sources of this folder only.
extern "C" {
#include <arv.h>
}

#include <memory>
#include <string>

namespace fathom::io {

struct Unref {
  void operator()(void* object) const noexcept { g_object_unref(object); }
};
template <typename T>
using GObjectPtr = std::unique_ptr<T, Unref>;

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

}  // namespace fathom::io
