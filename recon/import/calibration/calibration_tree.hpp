#pragma once

#include <string>
#include <string_view>

#include "recon/import/calibration/camera_pair.hpp"

namespace fathom::topside {

// The text of a file. Throws InputError for one that cannot be read, is over 4 MB, or is no text.
[[nodiscard]] std::string readCalibrationText(const std::filesystem::path& file);

// A number in decimal notation, alone and finite, as OpenCV writes it too ("1.", "-3.e-01", "+2"); none else.
[[nodiscard]] std::optional<double> decimalNumber(std::string_view text);

// YAML, XML or JSON, distinguished by the first character, as one kind of tree: maps, lists, numbers and
// texts.
// - YAML 1.1, its first document; the line "%YAML:1.0" of OpenCV is passed over; references are refused.
// - XML: elements by name, below the root; elements of one name are a list; numbers side by side are a list;
//   attributes are left out.
// Throws InputError for what cannot be parsed and for more than 32 levels.
[[nodiscard]] CalibrationTree parseCalibrationTree(const std::string& text,
                                                   const std::filesystem::path& file);

}  // namespace fathom::topside
