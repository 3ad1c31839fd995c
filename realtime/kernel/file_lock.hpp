#pragma once

#include <sys/file.h>

#include <cerrno>

namespace fathom {

// Whether another program holds the lock of an open file or folder; if not, this one has it until it closes
// it. `kind`: LOCK_EX, or LOCK_SH with others. A file system without locks is taken as it is: nobody holds
// any.
[[nodiscard]] inline bool lockedElsewhere(int file, int kind = LOCK_EX) noexcept {
  return ::flock(file, kind | LOCK_NB) != 0 && errno == EWOULDBLOCK;
}

}  // namespace fathom
