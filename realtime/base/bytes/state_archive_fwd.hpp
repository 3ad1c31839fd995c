#pragma once

// For headers that only name the archive (state_archive.hpp).
namespace fathom::rt {

class StateWriter;
class StateReader;

}  // namespace fathom::rt
