#pragma once

#include "realtime/kernel/heap_counter.hpp"

namespace fathom::test {

using rt::sanitized;
using rt::threadCost;
using rt::ThreadCost;

}  // namespace fathom::test
