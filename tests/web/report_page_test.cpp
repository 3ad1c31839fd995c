#include "telemetry/web/report_page.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cstdlib>
#include <fstream>
#include <iterator>

#include "tests/support/test_data.hpp"

namespace fathom::web {
namespace {

// A picture of one pixel.
constexpr const char* kPixel =
    "data:image/"
    "png;base64,iVBORw0KGgoAAAANSUhEUgAAAAEAAAABCAYAAAAfFcSJAAAADUlEQVR42mNk+M9QDwADhgGAWjR9awAAAABJ"
    "RU5ErkJggg==";

TEST(ReportPage, HoldsItsContentInOneFileAndNothingInItCanEndItsPlace) {
  const test::TemporaryFolder folder;
  const std::string content =
      R"({"title":"A dive </script> & more","about":"of a test","sections":[{"title":"Words","parts":[{"text":"plain"},)"
      R"({"text":"loud","strong":true},{"list":["one","two"]},{"table":{"rows":[["pairs","8"]]}}]},)"
      R"({"title":"Figures","parts":[{"picture":{"source":")" +
      std::string(kPixel) +
      R"(","caption":"A picture"}},{"plot":{"title":"Track","x":"east [m]","y":"north [m]","equal":true,"series":[)"
      R"({"label":"way","kind":"line","colour":"#ff0000","x":[0,5,2],"y":[0,1,4]},)"
      R"({"label":"none","kind":"dots","colour":"#00ff00","x":[],"y":[]}]}}]}]})";
  const auto file = folder.path() / "report.html";
  writeReportPage(file, content);
  std::ifstream in(file);
  const std::string html{std::istreambuf_iterator<char>(in), std::istreambuf_iterator<char>()};
  EXPECT_THAT(html, testing::HasSubstr(R"({"title":"A dive \u003c/script> & more")"));
  EXPECT_THAT(html, testing::Not(testing::HasSubstr("FATHOM_CONTENT")));
  EXPECT_EQ(std::distance(std::filesystem::directory_iterator(folder.path()), {}), 1) << "no temporary file";
  // For the test in a browser.
  if (const char* kept = std::getenv("FATHOM_TEST_REPORT")) writeReportPage(kept, content);
}

}  // namespace
}  // namespace fathom::web
