#pragma once

// A place at the boundary of a part where a test lets the part fail (tests/support/bad_parts.hpp). Nothing of
// an installed program defines it: there a pointer is compared with null.
extern "C" void fathomFaultPoint(const char* part) __attribute__((weak));

namespace fathom::rt {

// On the part's own thread, outside of locks. May throw where a test says so.
inline void faultPoint(const char* part) {
  if (fathomFaultPoint != nullptr) fathomFaultPoint(part);
}

}  // namespace fathom::rt
