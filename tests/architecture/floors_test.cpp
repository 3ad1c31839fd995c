#include "tests/architecture/floors.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <fstream>

#include "tests/support/test_data.hpp"

namespace fathom::test {
namespace {

using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;

const std::filesystem::path kRoot = FATHOM_SOURCE_DIR;

void write(const std::filesystem::path& path, const std::string& text) {
  std::filesystem::create_directories(path.parent_path());
  std::ofstream(path) << text;
}

TEST(House, NoFileIncludesOneThatItsFloorForbids) {
  Violations relative;
  const IncludeEdges edges = readIncludes(kRoot, relative);
  EXPECT_THAT(relative, IsEmpty());
  EXPECT_THAT(checkIncludes(edges), IsEmpty());
  // The reader sees what is certainly there.
  EXPECT_TRUE(edges.count({"recon/geometry/mesh.hpp", "recon/geometry/se3.hpp"}));
  EXPECT_TRUE(edges.count({"recon/geometry/mesh_io.cpp", "realtime/kernel/input_error.hpp"}));
}

TEST(House, NoFileIncludesItselfInTheEnd) {
  Violations relative;
  EXPECT_THAT(findCycles(readIncludes(kRoot, relative)), IsEmpty());
}

TEST(House, NoTargetLinksOneThatItsFloorForbids) {
  const auto targets = readTargets(FATHOM_TARGETS_FILE);
  EXPECT_THAT(checkTargets(targets), IsEmpty());
  ASSERT_TRUE(targets.count("fathom_kernel"));
  ASSERT_TRUE(targets.count("fathom_geometry"));
  EXPECT_EQ(targets.at("fathom_geometry").folder, "recon/geometry");
  EXPECT_TRUE(targets.at("fathom_geometry").libraries.count("fathom_kernel"));
}

TEST(Floors, EachRoomKnowsItselfAndWhatLiesBelow) {
  const auto may = [](const std::string& from, const std::string& to) {
    return mayKnow(placeOf(from).value(), placeOf(to).value());
  };
  EXPECT_TRUE(may("recon/geometry/a.cpp", "realtime/kernel/b.hpp"));
  EXPECT_TRUE(may("recon/stereo/a.cpp", "recon/stereo/detail/b.hpp"));
  EXPECT_TRUE(may("firmware_if/a.cpp", "recon/geometry/b.hpp"));
  EXPECT_TRUE(may("sim/link/a.cpp", "telemetry/b.hpp"));
  EXPECT_TRUE(may("sim/score/a.cpp", "recon/fusion/b.hpp"));
  EXPECT_TRUE(may("sim/main.cpp", "sim/a_command.hpp"));
  EXPECT_TRUE(may("sim/a_command.cpp", "sim/link/b.hpp"));
  EXPECT_TRUE(may("sim/a_command.cpp", "realtime/onboard/b.hpp"));
  EXPECT_TRUE(may("telemetry/monitor/a.cpp", "telemetry/b.hpp"));
  EXPECT_TRUE(may("firmware_if/main.cpp", "firmware_if/b.hpp"));
  EXPECT_TRUE(may("firmware_if/sensors_main.cpp", "telemetry/b.hpp"));

  EXPECT_FALSE(may("realtime/kernel/a.cpp", "recon/geometry/b.hpp"));
  EXPECT_FALSE(may("recon/geometry/a.cpp", "recon/stereo/b.hpp"));
  EXPECT_FALSE(may("recon/stereo/a.cpp", "recon/fusion/b.hpp"));
  EXPECT_FALSE(may("recon/nav/a.cpp", "firmware_if/b.hpp"));
  EXPECT_FALSE(may("firmware_if/a.cpp", "telemetry/b.hpp"));
  EXPECT_FALSE(may("telemetry/a.cpp", "telemetry/monitor/b.hpp"));
  for (const char* production :
       {"telemetry/a.cpp", "telemetry/monitor/a.cpp", "telemetry/monitor/main.cpp", "realtime/onboard/a.cpp",
        "realtime/onboard/main.cpp", "recon/topside/main.cpp", "firmware_if/sensors_main.cpp"}) {
    EXPECT_FALSE(may(production, "sim/link/b.hpp")) << production;
    EXPECT_FALSE(may(production, "sim/a_command.hpp")) << production;
  }
  EXPECT_FALSE(may("sim/link/a.cpp", "realtime/onboard/b.hpp"));
  EXPECT_FALSE(may("sim/link/a.cpp", "sim/a_command.hpp"));
  EXPECT_FALSE(may("realtime/onboard/a.cpp", "recon/topside/b.hpp"));
  EXPECT_FALSE(may("firmware_if/a.cpp", "firmware_if/sensors_main.cpp"));
}

TEST(Floors, WhatIsInNoRoomHasNoPlace) {
  EXPECT_FALSE(placeOf("tests/support/a.hpp"));
  EXPECT_FALSE(placeOf("recon/a.hpp"));
  EXPECT_FALSE(placeOf("realtime/a.hpp"));
  EXPECT_FALSE(placeOf("realtime/elsewhere/a.hpp"));
}

TEST(Floors, AForbiddenIncludeIsFoundInATree) {
  const TemporaryFolder tree;
  write(tree.path() / "recon/nav/good.cpp", "#include \"recon/geometry/se3.hpp\"\n#include <vector>\n");
  write(tree.path() / "recon/nav/bad.cpp", "  #  include <recon/stereo/match.hpp>\n");
  write(tree.path() / "firmware_if/bad.hpp", "#include \"firmware_if/../telemetry/frame.hpp\"\n");
  write(tree.path() / "telemetry/near.hpp", "");
  write(tree.path() / "telemetry/bad.cpp",
        "#include \"near.hpp\"\n#include \"tests/support/test_data.hpp\"\n");
  std::filesystem::create_directories(tree.path() / "tests");
  Violations relative;
  const IncludeEdges edges = readIncludes(tree.path(), relative);
  EXPECT_THAT(relative, ElementsAre(HasSubstr("telemetry/bad.cpp includes \"near.hpp\"")));
  EXPECT_THAT(checkIncludes(edges),
              ElementsAre(HasSubstr("firmware_if/bad.hpp"), HasSubstr("recon/nav/bad.cpp"),
                          HasSubstr("telemetry/bad.cpp includes tests/support/test_data.hpp")));
}

TEST(Floors, ACycleOfIncludesIsFound) {
  EXPECT_THAT(findCycles({{"a", "b"}, {"b", "c"}, {"c", "a"}, {"d", "a"}, {"c", "e"}}),
              ElementsAre("a -> b -> c -> a"));
  EXPECT_THAT(findCycles({{"a", "b"}, {"a", "c"}, {"b", "d"}, {"c", "d"}}), IsEmpty());
  EXPECT_THAT(findCycles({{"a", "a"}}), ElementsAre("a -> a"));
}

TEST(Floors, AForbiddenLinkIsFoundThroughGeneratorExpressionsToo) {
  const TemporaryFolder folder;
  const auto file = folder.path() / "targets.txt";
  write(file,
        "k|STATIC_LIBRARY|realtime/kernel|Threads::Threads\n"
        "g|STATIC_LIBRARY|recon/geometry|k;Eigen3::Eigen\n"
        "stereo|STATIC_LIBRARY|recon/stereo|g;$<LINK_ONLY:fusion>\n"
        "fusion|STATIC_LIBRARY|recon/fusion|g\n"
        "core|STATIC_LIBRARY|realtime/onboard|stereo;fusion\n"
        "fathom-onboard|EXECUTABLE|realtime/onboard|core;sim\n"
        "fathom-sim|EXECUTABLE|sim|sim;core\n"
        "sim|STATIC_LIBRARY|sim|g;support\n"
        "support|STATIC_LIBRARY|tests/support|\n"
        "some_test|EXECUTABLE|tests/nav|core;support\n");
  EXPECT_THAT(checkTargets(readTargets(file)),
              ElementsAre(HasSubstr("fathom-onboard"), HasSubstr("sim links support"), HasSubstr("stereo")));
}

TEST(Floors, AMissingListOfTargetsIsAnError) {
  EXPECT_THROW(readTargets("/nonexistent/targets.txt"), std::runtime_error);
}

}  // namespace
}  // namespace fathom::test
