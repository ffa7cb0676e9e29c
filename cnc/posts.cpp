// SPDX-License-Identifier: GPL-3.0-or-later
#include "cnc/posts.hpp"

#include <array>

namespace maquette::cnc {
namespace {

constexpr std::array kPosts{
    Post{"linuxcnc", "G21 G90 G17 G94 G40 G49 G80", true, "T1 M6\nG43 H1\n"},
    // Grbl 1.1 refuses G64, M6 and G43; its modes start as written here.
    Post{"grbl", "G21 G90 G17 G94 G40 G49 G80", false, ""},
};

}  // namespace

std::optional<Post> post_by_name(std::string_view name) {
  for (const Post& post : kPosts)
    if (post.name == name) return post;
  return std::nullopt;
}

std::string post_names() {
  std::string names;
  for (const Post& post : kPosts) names.append(names.empty() ? "" : ", ").append(post.name);
  return names;
}

}  // namespace maquette::cnc
