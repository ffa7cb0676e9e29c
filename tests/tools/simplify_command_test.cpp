// SPDX-License-Identifier: GPL-3.0-or-later

// maquette simplify, as a user starts it: a stone's STL to a count and to a deviation, its
// certificate; options that say nothing or too much, its own file as output, what is no mesh.

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

#include "export/cad.hpp"
#include "meshing/mesh_io.hpp"
#include "support/matchers.hpp"
#include "support/program.hpp"
#include "support/shapes.hpp"

namespace maquette::tools {
namespace {

using nlohmann::json;
using testing::HasSubstr;
using testing_support::run_program;
using testing_support::slurp;

TEST(SimplifyCommand, WritesABodyAndItsCertificate) {
  const testing_support::ScratchFolder scratch;
  const auto stl = (scratch / "rock.stl").string(), ply = (scratch / "few.ply").string();
  ASSERT_TRUE(
      exporting::write_stl(testing_support::random_rock(5, {}, 10.0), scratch / "rock.stl"));
  const std::string verb = fmt::format("simplify '{}' --quiet --out '{}' ", stl, ply);
  ASSERT_EQ(run_program(scratch.path(), verb + "--triangles 500").exit_code, 0);
  const auto few = meshing::read_mesh(ply);
  ASSERT_TRUE(few.has_value());
  EXPECT_LE(few->triangles.size(), 500U);
  const json said = json::parse(slurp(scratch / "few.certificate.json"));
  EXPECT_EQ(said["passed"], true);
  EXPECT_EQ(said["triangles"], few->triangles.size());
  EXPECT_EQ(said["triangles_before"], 5120);
  EXPECT_GT(said["max_deviation_mm"].get<double>(), 0.0);
  ASSERT_EQ(run_program(scratch.path(), verb + "--max-deviation-mm 0.3").exit_code, 0);
  EXPECT_LE(json::parse(slurp(scratch / "few.certificate.json"))["max_deviation_mm"].get<double>(),
            0.3);

  const auto refused = [&](const std::string& arguments, const std::string& words) {
    const auto o = run_program(scratch.path(), "simplify " + arguments);
    EXPECT_EQ(o.exit_code, 2) << arguments;
    EXPECT_THAT(o.err, HasSubstr(words)) << arguments;
  };
  refused(fmt::format("'{}'", stl), "--triangles or --max-deviation-mm");
  refused(fmt::format("'{}' --triangles 9 --max-deviation-mm 1", stl), "--triangles");
  refused(fmt::format("'{0}' --triangles 100 --out '{0}'", ply), "would be overwritten");
  refused(fmt::format("'{}' --triangles 100", (scratch / "none.stl").string()), "none.stl");
}

}  // namespace
}  // namespace maquette::tools
