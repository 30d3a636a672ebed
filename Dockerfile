# teamslam with all that a robot or a desk needs; by default it runs the demo:
#
#     docker build -t teamslam .
#     docker run --rm -v "$PWD/out:/data" teamslam                              the demo, figures in ./out/demo
#     docker run --rm -v "$PWD:/data" teamslam run my-team --out my-map         any other command
FROM debian:bookworm-slim AS build
RUN apt-get update && apt-get install -y -q --no-install-recommends python3-venv g++ && rm -rf /var/lib/apt/lists/*
RUN python3 -m venv /opt/teamslam
COPY . /source
RUN /opt/teamslam/bin/pip install --no-cache-dir --disable-pip-version-check "/source[robots,bags,tags,view]"

FROM debian:bookworm-slim
RUN apt-get update && apt-get install -y -q --no-install-recommends python3 && rm -rf /var/lib/apt/lists/*
COPY --from=build /opt/teamslam /opt/teamslam
ENV PATH=/opt/teamslam/bin:$PATH MPLCONFIGDIR=/tmp/matplotlib
WORKDIR /data
ENTRYPOINT ["teamslam"]
CMD ["demo"]
