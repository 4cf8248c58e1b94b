#!/usr/bin/env bash
# SPDX-License-Identifier: BSD-3-Clause
#
# Builds the site of docs/ into out/site: .venv-docs holds mkdocs (scripts/docs/requirements.txt).
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/../.."

python=python3
if [ -x /usr/bin/python3 ]; then python=/usr/bin/python3; fi
stamp=.venv-docs/.stamp-$(sha256sum scripts/docs/requirements.txt | cut -c1-16)
if [ ! -e "$stamp" ]; then
  echo "docs: creating .venv-docs"
  rm -rf .venv-docs
  "$python" -m venv .venv-docs
  .venv-docs/bin/python -m pip install --quiet --disable-pip-version-check \
    -r scripts/docs/requirements.txt
  touch "$stamp"
fi

# A font with the measures of formulas, from Debian's package, unpacked without installing it. Where
# it cannot be had the site uses the reader's own.
font=.venv-docs/fonts/STIXMath-Regular.otf
if [ ! -e "$font" ] && command -v apt-get dpkg >/dev/null; then
  mkdir -p .venv-docs/fonts
  folder=$(mktemp -d)
  if (cd "$folder" && apt-get download -qq fonts-stix && dpkg -x fonts-stix_*.deb .) 2>/dev/null; then
    find "$folder" -name STIXMath-Regular.otf -exec cp {} "$font" \;
  else
    echo "docs: no font for formulas (Debian's fonts-stix could not be fetched)"
  fi
  rm -rf "$folder"
fi

NO_MKDOCS_2_WARNING=1 .venv-docs/bin/mkdocs build --strict --quiet
"$python" scripts/docs/check_links.py
echo "docs: the site is out/site/index.html"
