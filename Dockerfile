# hydro without a graphics card, for a user without root rights:
#
#     docker build -t hydro .
#     docker run --rm -v "$PWD:/data" hydro explain vehicle.toml dive.mcap --map map.toml -o study
FROM python:3.11-slim AS build
WORKDIR /src
COPY . .
RUN pip install --no-cache-dir build && python -m build --wheel --outdir /wheels

FROM python:3.11-slim
# Extras of the distribution. `--build-arg EXTRAS=logs,learn` adds torch, which trains the networks of the second part of
# `hydro demo`; without it the image needs a quarter of the space.
ARG EXTRAS=logs
COPY --from=build /wheels /wheels
RUN pip install --no-cache-dir "$(ls /wheels/*.whl)[$EXTRAS]" && rm -r /wheels \
    && useradd --create-home hydro && mkdir /data && chown hydro /data
USER hydro
WORKDIR /data
RUN hydro warm
ENTRYPOINT ["hydro"]
CMD ["--help"]
