#include "realtime/kernel/input_error.hpp"

#include <cstdio>
#include <exception>

namespace fathom {

int runTool(const char* program, const std::function<int()>& body) noexcept {
  try {
    return body();
  } catch (const InputError& e) {
    std::fprintf(stderr, "%s: %s\n", program, e.what());
    return kExitBadInput;
  } catch (const std::exception& e) {
    std::fprintf(stderr, "%s: failed: %s\n", program, e.what());
    return kExitFailedWork;
  }
}

}  // namespace fathom
