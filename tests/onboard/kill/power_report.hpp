#pragma once

#include "tests/support/report_program.hpp"

namespace fathom::test {

// What a machine that loses its power costs the live program.
[[nodiscard]] Report powerReport();

}  // namespace fathom::test
