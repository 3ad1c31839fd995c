#pragma once

#include <optional>
#include <string>
#include <vector>

#include "recon/calibration/chessboard.hpp"
#include "recon/geometry/camera.hpp"

namespace fathom::calibration {

// One board as both cameras saw it at the same moment.
struct BoardView {
  std::string name;
  Corners left, right;
};

// A pair that is not used, and why.
struct DroppedView {
  std::string name, reason;
};

// A chessboard turned by half a turn (a square one also by quarter turns) shows the same corners, so that the
// two cameras may count them from opposite ends. The rig is rigid: the relative pose of the cameras is the
// same in every view. Finds the relative rotation on which most views agree, by any count of their corners,
// and reorders each view's right corners to it; of two that as many agree on, the smaller rotation is taken.
// Gives, for each view, whether it agrees (one that does not was not taken at the same moment, or its corners
// are wrong). `left`, `right`: intrinsics, good to a few per cent.
[[nodiscard]] std::vector<bool> alignBoards(const Camera& left, const Camera& right, const Chessboard& board,
                                            std::vector<BoardView>& views);

}  // namespace fathom::calibration
