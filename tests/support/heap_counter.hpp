#pragma once

#include "realtime/kernel/memory/heap_counter.hpp"

namespace fathom::test {

using rt::sanitized;
using rt::threadCost;
using rt::ThreadCost;

}  // namespace fathom::test
