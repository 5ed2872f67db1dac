// The live page: binary messages are meshcat commands, text messages are for the panel.
"use strict";
(() => {
  let looked = false;
  function connect() {
    const socket = new WebSocket(`${location.protocol === "https:" ? "wss" : "ws"}://${location.host}/follow`);
    socket.binaryType = "arraybuffer";
    socket.onmessage = (message) => {
      if (typeof message.data !== "string") {
        viewer.handle_command_message(message);
        return;
      }
      const told = JSON.parse(message.data);
      if (told.info) {
        viewer.delete_path(["wbc"]);      // what an earlier run left in this page
        wbc.setup(told.info);
        if (!looked) wbc.look(viewer);
        looked = true;
      }
      if (told.state) wbc.show(told.state);
    };
    socket.onclose = () => {
      wbc.end("the viewer has ended");
      setTimeout(connect, 1000);          // a later run on the same port takes this page over
    };
  }
  connect();
})();
