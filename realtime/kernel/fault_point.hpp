#pragma once

// Hook at the boundary of a part where a test makes the part fail (tests/support/bad_parts.hpp). An installed
// program does not define it; the cost there is a comparison with null.
extern "C" void fathomFaultPoint(const char* part) __attribute__((weak));

namespace fathom::rt {

// Called on the part's own thread, outside of locks. May throw if a test defines it so.
inline void faultPoint(const char* part) {
  if (fathomFaultPoint != nullptr) fathomFaultPoint(part);
}

}  // namespace fathom::rt
