#pragma once

// An HTTP client that is not ours, for tests of our servers.
#include <httplib.h>
// The resolver's header, which it brings, takes a name that Eigen uses.
#undef _res
