// SPDX-License-Identifier: GPL-3.0-or-later

// camera/image_io.hpp:
//   EXR keeps floats, names, text .... read back by OpenImageIO itself, inf and tiny
//   PNG keeps bytes and text ......... the same, grey and colour, row 0 on top
//   TIFF and JPEG keep text too ...... by our reader and OpenImageIO's; longer than a segment; the
//                                      pixels as without
//   read_image scales, keeps coding .. 8 and 16 bit files written by OpenImageIO
//   alpha does not multiply .......... values under transparent pixels
//   sRGB ............................. values of IEC 61966-2-1, order, clamping
//   raw files ........................ a DNG of grey: linear light as shot, 1 where the sensor ends
//   bad files and bad folders ........ each error code; nothing is left behind
//   same bytes ....................... written twice

#include "camera/image_io.hpp"

#include <fstream>
#include <limits>

#include <OpenImageIO/imageio.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "support/matchers.hpp"

namespace maquette::camera {
namespace {

using testing_support::FailsWith;
using testing_support::ScratchFolder;
using testing_support::Succeeds;

Grid<float> ramp(std::ptrdiff_t rows, std::ptrdiff_t cols, float scale) {
  Grid<float> g(rows, cols);
  for (std::ptrdiff_t r = 0; r < rows; ++r)
    for (std::ptrdiff_t c = 0; c < cols; ++c) g(r, c) = scale * static_cast<float>(r * cols + c);
  return g;
}

TEST(WriteExr, KeepsFloatsNamesAndText) {
  const ScratchFolder folder;
  const Grid<float> light = ramp(5, 7, 0.1F);
  Grid<float> depth = ramp(5, 7, 1e-30F);
  depth(2, 3) = std::numeric_limits<float>::infinity();
  ASSERT_THAT(write_exr({{"Y", &light}, {"Z", &depth}}, folder / "a.exr",
                        {{"maquette:frame", "model, mm"}, {"scene", "Hügel"}}),
              Succeeds());

  const auto in = OIIO::ImageInput::open((folder / "a.exr").string());
  ASSERT_TRUE(in);
  EXPECT_EQ(in->spec().width, 7);
  EXPECT_EQ(in->spec().height, 5);
  EXPECT_EQ(in->spec().get_string_attribute("maquette:frame"), "model, mm");
  EXPECT_EQ(in->spec().get_string_attribute("scene"), "Hügel");

  const auto back = read_image(folder / "a.exr");
  ASSERT_THAT(back, Succeeds());
  EXPECT_FALSE(back->eight_bit);
  ASSERT_THAT(back->names, testing::UnorderedElementsAre("Y", "Z"));
  for (std::size_t k = 0; k < 2; ++k)
    EXPECT_EQ(back->channels[k], back->names[k] == "Y" ? light : depth);
}

TEST(WritePng, KeepsBytesAndText) {
  const ScratchFolder folder;
  Grid<std::uint8_t> grey(3, 256);
  Grid<Rgb8> colour(3, 256);
  for (std::ptrdiff_t r = 0; r < 3; ++r)
    for (std::ptrdiff_t c = 0; c < 256; ++c) {
      grey(r, c) = static_cast<std::uint8_t>((c + 10 * r) % 256);
      colour(r, c) = {grey(r, c), static_cast<std::uint8_t>(255 - c), static_cast<std::uint8_t>(r)};
    }
  ASSERT_THAT(write_png(grey, folder / "g.png", {{"Seed", "42"}}), Succeeds());
  ASSERT_THAT(write_png(colour, folder / "c.png", {{"Seed", "43"}}), Succeeds());
  const auto g = read_image(folder / "g.png");
  const auto c = read_image(folder / "c.png");
  ASSERT_THAT(g, Succeeds());
  ASSERT_THAT(c, Succeeds());
  EXPECT_TRUE(g->eight_bit);
  EXPECT_TRUE(c->eight_bit);
  ASSERT_EQ(g->channels.size(), 1U);
  ASSERT_EQ(c->channels.size(), 3U);
  EXPECT_THAT(c->names, testing::ElementsAre("R", "G", "B"));
  for (std::ptrdiff_t r = 0; r < 3; ++r)
    for (std::ptrdiff_t x = 0; x < 256; ++x) {
      EXPECT_EQ(std::lround(255 * g->channels[0](r, x)), grey(r, x));
      for (std::size_t k = 0; k < 3; ++k)
        EXPECT_EQ(std::lround(255 * c->channels[k](r, x)), colour(r, x)[k]);
    }
  const auto in = OIIO::ImageInput::open((folder / "c.png").string());
  ASSERT_TRUE(in);
  EXPECT_EQ(in->spec().get_string_attribute("Seed"), "43");
}

class KeepsMetadata : public testing::TestWithParam<const char*> {};

// Texts of a scene: quotes, ends of lines, letters beyond ASCII, and more than the 65533 bytes of a
// JPEG's segment or the 65536 up to which OpenImageIO reads a TIFF's description.
TEST_P(KeepsMetadata, OfAnyLength) {
  const ScratchFolder folder;
  const Grid<float> grey = ramp(30, 40, 1.0F / 1200.0F);
  for (const std::size_t length : {std::size_t{10}, std::size_t{65000}, std::size_t{300000}}) {
    std::string scene = "name = \"Hügel\"\n\t# \\ {}\n";
    while (scene.size() < length) scene += "[[object]]\nmesh = \"part.obj\"\n";
    const Metadata metadata{{"maquette:scene", scene}, {"maquette:seed", "7"}};
    const auto path = folder / (std::string("a") + GetParam());
    ASSERT_THAT(write_whole_numbers({{"Y", &grey}}, 1.0, 8, path, metadata), Succeeds());
    const auto with = read_image(path);
    ASSERT_THAT(with, Succeeds());
    EXPECT_THAT(with->metadata, testing::UnorderedElementsAreArray(metadata)) << length;
    ASSERT_THAT(write_whole_numbers({{"Y", &grey}}, 1.0, 8, path), Succeeds());
    const auto without = read_image(path);
    ASSERT_THAT(without, Succeeds());
    EXPECT_TRUE(without->metadata.empty());
    EXPECT_EQ(with->channels, without->channels);
  }
}
INSTANTIATE_TEST_SUITE_P(Formats, KeepsMetadata, testing::Values(".png", ".tif", ".jpg"));

TEST(WriteImages, SaysItWhereOtherProgramsLook) {
  const ScratchFolder folder;
  const Grid<float> grey = ramp(30, 40, 1.0F / 1200.0F);
  for (const char* name : {"a.tif", "a.jpg"}) {
    ASSERT_THAT(
        write_whole_numbers({{"Y", &grey}}, 1.0, 8, folder / name, {{"maquette:seed", "7"}}),
        Succeeds());
    const auto in = OIIO::ImageInput::open((folder / name).string());
    ASSERT_TRUE(in);
    EXPECT_EQ(in->spec().get_string_attribute("ImageDescription"), R"({"maquette:seed":"7"})")
        << name;
  }
}

TEST(ReadImage, TakesForeignCommentsForNoMetadata) {
  const ScratchFolder folder;
  const Grid<float> grey = ramp(30, 40, 1.0F / 1200.0F);
  ASSERT_THAT(write_whole_numbers({{"Y", &grey}}, 1.0, 8, folder / "a.jpg"), Succeeds());
  const std::string plain = read_file(folder / "a.jpg").value();
  // Behind the start of the image a comment that is no JSON; one without a key of ours.
  for (const char* said : {"by a camera", "{\"a\":\"bc\"}"}) {
    const std::string text(said);
    ASSERT_TRUE(write_file(folder / "said.jpg", plain.substr(0, 2) + std::string("\xFF\xFE\0", 3) +
                                                    static_cast<char>(text.size() + 2) + text +
                                                    plain.substr(2)));
    const auto image = read_image(folder / "said.jpg");
    ASSERT_THAT(image, Succeeds());
    EXPECT_TRUE(image->metadata.empty());
  }
}

TEST(WriteImages, GivesTheSameBytesTwice) {
  const ScratchFolder folder;
  const Grid<float> light = ramp(300, 200, 0.01F);
  const Grid<std::uint8_t> grey(300, 200, 7);
  for (const char* name : {"1", "2"}) {
    ASSERT_THAT(write_exr({{"Y", &light}}, folder / (std::string(name) + ".exr")), Succeeds());
    ASSERT_THAT(write_png(grey, folder / (std::string(name) + ".png")), Succeeds());
  }
  EXPECT_EQ(sha256_file(folder / "1.exr").value(), sha256_file(folder / "2.exr").value());
  EXPECT_EQ(sha256_file(folder / "1.png").value(), sha256_file(folder / "2.png").value());
}

TEST(ReadImage, ScalesSixteenBitsAndLeavesAlphaAlone) {
  const ScratchFolder folder;
  const auto path = (folder / "w.png").string();
  const OIIO::ImageSpec spec(2, 1, 4, OIIO::TypeDesc::UINT16);
  const std::array<std::uint16_t, 8> pixels{65535, 32768, 0, 0, 1000, 2000, 3000, 30000};
  auto out = OIIO::ImageOutput::create(path);
  ASSERT_TRUE(out && out->open(path, [&] {
    OIIO::ImageSpec s = spec;
    s.attribute("oiio:UnassociatedAlpha", 1);
    return s;
  }()));
  ASSERT_TRUE(out->write_image(OIIO::TypeDesc::UINT16, pixels.data()));
  out->close();
  const auto image = read_image(path);
  ASSERT_THAT(image, Succeeds());
  EXPECT_FALSE(image->eight_bit);
  for (std::size_t k = 0; k < 4; ++k)
    for (std::ptrdiff_t c = 0; c < 2; ++c)
      EXPECT_NEAR(image->channels[k](0, c),
                  static_cast<float>(pixels[static_cast<std::size_t>(4 * c) + k]) / 65535.0F, 1e-6)
          << "channel " << k;
}

TEST(Srgb8, HasTheValuesOfTheStandard) {
  EXPECT_EQ(srgb8(0.0), 0);
  EXPECT_EQ(srgb8(1.0), 255);
  EXPECT_EQ(srgb8(0.5), 188);        // 187.5 by the formula
  EXPECT_EQ(srgb8(0.2140411), 127);  // 127.5 / 255 decoded is 0.21586
  EXPECT_EQ(srgb8(0.0031308), 10);   // where line meets power: 10.31
  EXPECT_EQ(srgb8(-1.0), 0);
  EXPECT_EQ(srgb8(7.0), 255);
  EXPECT_EQ(srgb8(NAN), 0);
  for (int i = 0; i < 1000; ++i) EXPECT_LE(srgb8(i / 1000.0), srgb8((i + 1) / 1000.0));
}

TEST(ReadImage, SaysWhatIsWrong) {
  const ScratchFolder folder;
  EXPECT_THAT(read_image(folder / "none.png"), FailsWith(kFileNotFound));
  ASSERT_TRUE(write_file(folder / "noise.png", std::string(5000, 'x')));
  EXPECT_THAT(read_image(folder / "noise.png"), FailsWith(kImageNotReadable));
  ASSERT_TRUE(write_file(folder / "noise.txt", "hello"));
  EXPECT_THAT(read_image(folder / "noise.txt"), FailsWith(kImageNotReadable));

  Grid<std::uint8_t> grey(200, 200);
  for (std::size_t i = 0; i < grey.cells().size(); ++i)
    grey.cells()[i] = static_cast<std::uint8_t>(i * i % 251);
  ASSERT_TRUE(write_png(grey, folder / "a.png"));
  const auto whole = read_file(folder / "a.png").value();
  ASSERT_TRUE(write_file(folder / "half.png", whole.substr(0, whole.size() / 2)));
  const auto half = read_image(folder / "half.png");
  ASSERT_THAT(half, FailsWith(kImageNotReadable));
  EXPECT_THAT(half.error().message, testing::HasSubstr("half.png"));
}

/// A DNG without compression (TIFF 6 and Adobe's DNG 1.4): RGGB, black 512, white 16383, of a
/// camera that sees sRGB's primaries and is half as sensitive in red, three quarters in blue.
std::string grey_dng(std::uint32_t width, std::uint32_t height, std::uint16_t left,
                     std::uint16_t right) {
  struct Tag {
    std::uint16_t tag, type;  // 1 byte, 2 text, 3 short, 4 long, 5 and 10 ratios
    std::uint32_t count;
    std::string bytes;
  };
  const auto number = [](auto v) {
    return std::string(reinterpret_cast<const char*>(&v), sizeof v);
  };
  std::vector<Tag> tags;
  const auto shorts = [&](std::uint16_t tag, std::initializer_list<std::uint16_t> all) {
    std::string bytes;
    for (const std::uint16_t v : all) bytes += number(v);
    tags.push_back({tag, 3, static_cast<std::uint32_t>(all.size()), bytes});
  };
  const auto longs = [&](std::uint16_t tag, std::uint32_t v) {
    tags.push_back({tag, 4, 1, number(v)});
  };
  const auto text = [&](std::uint16_t tag, const std::string& t) {
    tags.push_back({tag, 2, static_cast<std::uint32_t>(t.size() + 1), t + '\0'});
  };
  const auto ratios = [&](std::uint16_t tag, std::uint16_t type, std::vector<std::int32_t> all) {
    std::string bytes;
    for (const std::int32_t v : all) bytes += number(v) + number(std::int32_t{10000});
    tags.push_back({tag, type, static_cast<std::uint32_t>(all.size()), bytes});
  };
  longs(254, 0), longs(256, width), longs(257, height);
  shorts(258, {16}), shorts(259, {1}), shorts(262, {32803});
  text(271, "Test"), text(272, "Grey");
  longs(273, 0);  // where the strip begins, below
  shorts(274, {1}), shorts(277, {1});
  longs(278, height), longs(279, 2 * width * height);
  shorts(284, {1}), shorts(33421, {2, 2});
  tags.push_back({33422, 1, 4, std::string("\0\1\1\2", 4)});
  tags.push_back({50706, 1, 4, std::string("\1\4\0\0", 4)});
  text(50708, "Test Grey");
  longs(50714, 512), longs(50717, 16383);
  ratios(50721, 10, {32405, -15371, -4985, -9693, 18760, 416, 556, -2040, 10572});
  ratios(50728, 5, {5000, 10000, 7500});
  shorts(50778, {21});
  const std::size_t after = 8 + 2 + 12 * tags.size() + 4;
  std::string far;
  for (const Tag& t : tags)
    if (t.bytes.size() > 4) far += t.bytes + std::string(t.bytes.size() % 2, '\0');
  std::string file = std::string("II*\0", 4) + number(std::uint32_t{8}) +
                     number(static_cast<std::uint16_t>(tags.size()));
  std::size_t at = after;
  for (const Tag& t : tags) {
    file += number(t.tag) + number(t.type) + number(t.count);
    if (t.tag == 273) {
      file += number(static_cast<std::uint32_t>(after + far.size()));
    } else if (t.bytes.size() <= 4) {
      file += t.bytes + std::string(4 - t.bytes.size(), '\0');
    } else {
      file += number(static_cast<std::uint32_t>(at));
      at += t.bytes.size() + t.bytes.size() % 2;
    }
  }
  file += number(std::uint32_t{0}) + far;
  for (std::uint32_t y = 0; y < height; ++y)
    for (std::uint32_t x = 0; x < width; ++x) {
      const int light = x < width / 2 ? left : right;
      const int seen = (x + y) % 2 == 1 ? light : (y % 2 == 0 ? light / 2 : 3 * light / 4);
      file += number(static_cast<std::uint16_t>(512 + seen));
    }
  return file;
}

TEST(ReadImage, DevelopsRawFilesToLinearLight) {
  const std::string formats(OIIO::get_string_attribute("format_list"));
  if (formats.find("raw,") == std::string::npos)
    GTEST_SKIP() << "this OpenImageIO reads no raw files";
  const ScratchFolder folder;
  ASSERT_TRUE(write_file(folder / "grey.dng", grey_dng(64, 48, 8000, 2000)));
  const auto image = read_image(folder / "grey.dng");
  ASSERT_THAT(image, Succeeds());
  EXPECT_FALSE(image->eight_bit);
  ASSERT_EQ(image->channels.size(), 3U);
  for (const Grid<float>& band : image->channels) {
    ASSERT_EQ(band.cols(), 64);
    EXPECT_NEAR(band(20, 12), 8000.0 / (16383 - 512), 2e-4);
    EXPECT_NEAR(band(20, 52), 2000.0 / (16383 - 512), 2e-4);
  }
}

TEST(WriteImages, SayWhatIsWrongAndLeaveNothing) {
  const ScratchFolder folder;
  const Grid<float> a(4, 5), b(5, 4), none;
  EXPECT_THAT(write_exr({}, folder / "a.exr"), FailsWith(kImageFormat));
  EXPECT_THAT(write_exr({{"Y", &none}}, folder / "a.exr"), FailsWith(kImageFormat));
  EXPECT_THAT(write_exr({{"Y", &a}, {"Y", &a}}, folder / "a.exr"), FailsWith(kImageFormat));
  EXPECT_THAT(write_exr({{"", &a}}, folder / "a.exr"), FailsWith(kImageFormat));
  EXPECT_THAT(write_exr({{"Y", &a}, {"Z", &b}}, folder / "a.exr"), FailsWith(kImageFormat));
  EXPECT_THAT(write_exr({{"Y", &a}}, folder / "a.jpg"), FailsWith(kImageFormat));
  EXPECT_THAT(write_png(Grid<std::uint8_t>(2, 2), folder / "a.exr"), FailsWith(kImageFormat));
  EXPECT_THAT(write_png(Grid<Rgb8>(), folder / "a.png"), FailsWith(kImageFormat));
  EXPECT_THAT(write_exr({{"Y", &a}}, folder / "no/folder/a.exr"), FailsWith(kFileNotWritable));
  EXPECT_TRUE(std::filesystem::is_empty(folder.path()));
}

}  // namespace
}  // namespace maquette::camera
