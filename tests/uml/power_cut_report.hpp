#pragma once

#include "tests/support/report_program.hpp"

namespace fathom::uml {

// Cuts the power of a recording machine at random instants; a table of what each cut cost.
[[nodiscard]] test::Report powerCutReport();

}  // namespace fathom::uml
