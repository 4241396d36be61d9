# The command line in a small image:
#
#     docker build --tag cfreg .
#     docker run --rm cfreg demo
#     docker run --rm --user "$(id -u):$(id -g)" --volume "$PWD:/data" cfreg register source.ply target.ply

FROM rust:1-slim-bookworm AS build
WORKDIR /build
COPY . .
# Crates and objects of an earlier build are kept outside the image.
RUN --mount=type=cache,target=/usr/local/cargo/registry \
    --mount=type=cache,target=/build/target \
    CARGO_PROFILE_RELEASE_STRIP=symbols cargo build --release --locked --package cfreg --features cli \
    && cp target/release/cfreg /usr/local/bin/

FROM debian:bookworm-slim
LABEL org.opencontainers.image.source="https://github.com/cfreg/cfreg" \
      org.opencontainers.image.licenses="MIT OR Apache-2.0"
COPY --from=build /build/LICENSE-MIT /build/LICENSE-APACHE /usr/share/doc/cfreg/
COPY --from=build /usr/local/bin/cfreg /usr/local/bin/
# The program needs no rights. Results in a mounted folder want its owner: --user.
RUN install --directory --owner=1000 --group=1000 /data
USER 1000:1000
WORKDIR /data
ENTRYPOINT ["cfreg"]
